"""Data of one landing or one recording."""

from __future__ import annotations

import dataclasses
import re
from typing import Any, Dict, List, Optional

from ._lazy import numpy as np
from ._lazy import pandas
from ._program import AlightError

# Names for the columns of a vector. They are numbered, because axis letters would be wrong for either NED or body axes.
PART = "{name}_{part}"
# Steps between the values within a message, s: section and key of the program's configuration with its default. Every second stage
# is recorded (deploy/computer/src/record/views.rs).
PATHS = {"/deck/forecast/path": ("predictor", "stage_s", 0.1), "/plan/path": ("planner", "step_s", 0.1)}
RECORDED_STAGES = 2
UNITS = """units: the end of each name (_1ps is 1/s); eta: m (NED), rad (roll, pitch, yaw), eta_dot and eta_ddot: per s and s2;
  variances and covariances: their squares; slopes, loss, confidence, thrust, battery, alignment: ratios; quaternion_wxyz: of length 1"""


@dataclasses.dataclass(repr=False)
class Run:
    """One landing or one recording.

    outcome   for a trial the JSON of `alight trial --json`: `success`, `position_error_m` (deck's centre to the feet's
              centroid in the deck's plane at the first contact), `touchdown_speed_mps` (along the deck's normal),
              `roll_error_deg` ... (drone minus deck in the deck's axes), `landing_time_s` (first descent to first
              contact); for a file the outcome that it contains.
    series    topic -> name -> array over time. `time_s` is the simulated world's time for a trial, UTC since 1970 for a
              flight. Scalars are arrays of N, vectors of N x 3, forecasts and plans of N x K x 3. Unknown values are NaN.
              `/tf` has one series per frame, such as `/tf/drone` and `/tf/vessel`: the frame's position in its parent.
    files     attachments: configurations and the scenario, name -> text.
    flight    `flight.json` of a recorded flight; otherwise None.
    """

    outcome: Dict[str, Any]
    series: Dict[str, Dict[str, Any]]
    files: Dict[str, str] = dataclasses.field(default_factory=dict)
    flight: Optional[Dict[str, Any]] = None
    path: Optional[str] = None

    def __repr__(self) -> str:
        """Topics grouped by the period of their messages, steps within a message, and units."""
        steps: Dict[float, List[str]] = {}
        for topic, series in self.series.items():
            times = series["time_s"]
            step = float(f"{np.median(np.diff(times)):.2g}") if len(times) > 1 else 0.0
            steps.setdefault(step, []).append(topic)
        lines = [f"Run of {self.path or 'a trial'}: {self.outcome.get('outcome', 'no outcome')}; median step of each topic's time_s:"]
        lines += [f"  {step:g} s: {', '.join(topics)}" for step, topics in sorted(steps.items())]
        within = [f"{topic} {self._path_step_s(*key):g} s" for topic, key in PATHS.items() if topic in self.series]
        within += ["predicted_slopes 0.25 s, apparent_slopes 2 s back in time"]
        return "\n".join([*lines, f"steps within a message, from time_s on: {', '.join(within)}", UNITS])

    def _path_step_s(self, section: str, key: str, default: float) -> float:
        pattern = rf"^\[(?:drone\.)?{section}\]\n(?:(?!\[).*\n)*?{key} = ([0-9.]+)"
        found = re.search(pattern, "\n".join(self.files.values()), re.M)
        return RECORDED_STAGES * (float(found.group(1)) if found else default)

    def frame(self, topic: str):
        """Returns the series of a topic as a pandas DataFrame with `time_s` as its index; needs pandas."""
        columns = {}
        for name, values in self.topic(topic).items():
            if values.ndim == 1:
                columns[name] = values
            elif values.ndim == 2:
                for part in range(values.shape[1]):
                    columns[PART.format(name=name, part=part)] = values[:, part]
            # An array of N x K x 3 does not fit a table; `series` has it.
        return pandas.DataFrame(columns).set_index("time_s")

    def topic(self, topic: str) -> Dict[str, Any]:
        """Returns the series of a topic; the error for a missing topic names the available ones."""
        if topic not in self.series:
            there = ", ".join(sorted(self.series)) or "none"
            raise AlightError(f"no {topic} in {self.path or 'this run'}; there are: {there}")
        return self.series[topic]

    def entered(self, *states: str):
        """Times at which the mission entered one of these states (such as `Descent`), in the unit of `time_s`."""
        mission = self.topic("/mission")
        inside = np.isin(mission["state"], states)
        began = inside & ~np.concatenate([[False], inside[:-1]])
        return mission["time_s"][began]

    def touchdown_s(self) -> Optional[float]:
        """Returns the time of the first contact, in the unit of `time_s`; None without a landing.

        For a trial it is exact to a tick of 10 ms. For a recording it is the time at which the mission suspected the contact
        that it confirmed later, about 0.05 s after the contact.
        """
        descents = self.entered("Descent", "Flare")
        took = self.outcome.get("landing_time_s")
        if took is not None and len(descents):
            # The judge counts from the tick of the descent itself, at most one tick before the mission reports it.
            return float(descents[0] + took)
        landed = self.entered("Landed")
        if not len(landed):
            return None
        log = self.series.get("/log")
        for message in reversed(log["message"] if log is not None else []):
            suspected = re.search(r"contact suspected ([0-9.]+) s before", message)
            if suspected:
                return float(landed[-1]) - float(suspected.group(1))
        return float(landed[-1])
