"""The CSV that the program reads: columns, limits, and output."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, List

from .._lazy import numpy as np
from .._lazy import pandas
from .._program import AlightError

# Columns in order, with the largest magnitude that the program accepts (usv-side/src/log/table.rs).
LIMITS = {
    "roll_deg": 75.0,
    "pitch_deg": 75.0,
    "heading_deg": 1e5,
    "heave_m": 50.0,
    "surge_m": 1e5,
    "sway_m": 1e5,
    "gyro_x_radps": 50.0,
    "gyro_y_radps": 50.0,
    "gyro_z_radps": 50.0,
    "accel_x_mps2": 500.0,
    "accel_y_mps2": 500.0,
    "accel_z_mps2": 500.0,
    "latitude_deg": 90.0,
    "longitude_deg": 360.0,
    "altitude_m": 1e4,
    "north_mps": 100.0,
    "east_mps": 100.0,
    "down_mps": 100.0,
}
MAX_TIME_S = 1e10
MAX_ROWS = 2_000_000
# Decimals of times (us) and of values (0.1 mm of latitude).
TIME_DECIMALS, DECIMALS = 6, 9
GYRO = ("gyro_x_radps", "gyro_y_radps", "gyro_z_radps")
ACCEL = ("accel_x_mps2", "accel_y_mps2", "accel_z_mps2")
# Minimum time between two used attitudes and two used headings of an autopilot's filter, s; values in between repeat them.
ATTITUDE_STEP_S, HEADING_STEP_S = 0.04, 0.2


@dataclasses.dataclass
class Converted:
    """Result of a conversion.

    format   format of the recording
    notes    assumptions and omissions, for users
    table    the CSV as a pandas DataFrame, once it is written
    out      path of the CSV, once it is written
    """

    format: str
    notes: List[str] = dataclasses.field(default_factory=list)
    table: Any = None
    out: str = ""
    _parts: List[Any] = dataclasses.field(default_factory=list, repr=False)

    def add(self, t_s, **columns) -> None:
        """Adds rows: times (s) and values of columns in the units of their names; NaN marks values that were not measured."""
        part = pandas.DataFrame({"t_s": np.asarray(t_s, dtype=float), **columns})
        if len(part):
            self._parts.append(part)

    def add_attitude(self, t_s, roll, pitch, yaw=None) -> None:
        """Adds attitudes (rad, FRD to NED) of an autopilot's filter, no faster than the filter updates them."""
        t = np.asarray(t_s, dtype=float)
        keep = thinned(t, ATTITUDE_STEP_S)
        self.add(t[keep], roll_deg=np.degrees(roll)[keep], pitch_deg=np.degrees(pitch)[keep])
        if yaw is not None:
            self.add_heading(t, yaw)

    def add_heading(self, t_s, heading) -> None:
        """Adds headings (rad, clockwise from north) of an autopilot's filter or a compass."""
        t = np.asarray(t_s, dtype=float)
        keep = thinned(t, HEADING_STEP_S)
        self.add(t[keep], heading_deg=np.degrees(heading)[keep] % 360.0)

    def summary(self) -> str:
        """Description of the CSV: number of rows, duration and columns."""
        t = self.table["t_s"]
        return f"{self.format}, {len(t)} rows over {t.max() - t.min():.1f} s of {', '.join(self.table.columns[1:])}"

    def write(self, path: str, out: str) -> None:
        """Merges the parts by time, checks them, and writes the CSV."""
        if not self._parts:
            said = "".join(f"; {note}" for note in self.notes)
            raise AlightError(f"{path}: {self.format} without anything that is converted{said}", 2)
        table = pandas.concat(self._parts, ignore_index=True)
        table = table[["t_s", *(name for name in LIMITS if name in table and table[name].notna().any())]]
        if len(table) > MAX_ROWS:
            raise AlightError(f"{path}: {len(table)} rows, at most {MAX_ROWS} are read; cut the recording into parts", 2)
        table = self._sound(path, table)
        # Rows of equal time keep their order.
        table = table.sort_values("t_s", kind="stable", ignore_index=True)
        self.table = table.round({"t_s": TIME_DECIMALS, **{name: DECIMALS for name in LIMITS}})
        self.table.to_csv(out, index=False)
        self.out = out

    def _sound(self, path: str, table):
        """Rows within the limits that have a value; the others are counted."""
        allowed = table["t_s"].abs() <= MAX_TIME_S
        for name in table.columns[1:]:
            allowed &= table[name].isna() | (table[name].abs() <= LIMITS[name])
        beyond = int((~allowed).sum())
        if beyond > len(table) // 2:
            first = table[~allowed].iloc[0].dropna().to_dict()
            raise AlightError(f"{path}: {beyond} of {len(table)} rows hold values that no boat has, as {first}; check units", 2)
        if beyond:
            self.notes.append(f"{beyond} rows with values that no boat has are left out")
        return table[allowed & table[table.columns[1:]].notna().any(axis=1)]


def thinned(t, step_s: float):
    """Whether each of these times (s, ascending) is at least `step_s` after the last kept one."""
    keep, last = np.zeros(len(t), dtype=bool), -math.inf
    for k, at in enumerate(t):
        # A step back begins another run of the clock.
        if at - last >= step_s - 1e-6 or at < last:
            keep[k], last = True, at
    return keep


def rate_hz(t) -> float:
    """Typical rate of these times, Hz; 0 for fewer than two."""
    steps = np.diff(np.asarray(t, dtype=float))
    steps = steps[steps > 0]
    return float(1.0 / np.median(steps)) if len(steps) else 0.0


def euler(w, x, y, z):
    """Roll, pitch and yaw (ZYX, rad) of quaternions of any length; NaN for a zero quaternion."""
    w, x, y, z = (np.asarray(v, dtype=float) for v in (w, x, y, z))
    square = w * w + x * x + y * y + z * z
    with np.errstate(divide="ignore", invalid="ignore"):
        s = 2.0 / square
    roll = np.arctan2(s * (w * x + y * z), 1.0 - s * (x * x + y * y))
    pitch = np.arcsin(np.clip(s * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(s * (w * z + x * y), 1.0 - s * (y * y + z * z))
    return roll, pitch, yaw
