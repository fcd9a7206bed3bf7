"""Results of many landings: rates, studies, envelopes."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import tempfile
from typing import Any, Dict, List, Optional, Tuple

from . import _program
from ._lazy import pandas
from ._program import AlightError

DAY_S = 86_400.0
# Columns of rows.csv that always contain text.
TEXTS = {"outcome", "reason", "sea", "planner", "digest"}


@dataclasses.dataclass(repr=False)
class Trials:
    """Many landings of one scene.

    rows      one outcome per landing, as in `Run.outcome`, by seed: a pandas DataFrame, or without pandas a list of dicts
    summary   the JSON of `alight trial --trials N --json`
    rate      fraction of the landings that succeeded, 0 to 1
    interval  Wilson's 95 % interval of the rate
    """

    rows: Any
    summary: Dict[str, Any]
    rate: float
    interval: Tuple[float, float]

    def __repr__(self) -> str:
        low, high = (100 * limit for limit in self.interval)
        return f"Trials: {len(self.rows)} landings, {100 * self.rate:.0f} % landed (95 % interval {low:.0f} to {high:.0f} %); rows, summary"


@dataclasses.dataclass(repr=False)
class Study:
    """Results of a study.

    rows     one outcome per landing (`rows.csv`): a pandas DataFrame, or without pandas a list of dicts; `sea` is the name
             of the study's row, `planner` the planner that flew it
    summary  `rows` of `summary.json`: for each row and planner, in the study's order, `scenario`, `planner`, `trials`,
             `successes`, `success_rate_95`, mean, sd, p50, p95, max of each metric, `mean_95` (bootstrap intervals of the
             means), `worst_seeds`, `against` (differences from the first planner on the same seeds); `replay` is the command
             that repeats its trials; `published` if the row has a published counterpart
    pooled   the same for pools of scenes, and for all of them
    """

    name: str
    rows: Any
    summary: List[Dict[str, Any]]
    pooled: List[Dict[str, Any]] = dataclasses.field(default_factory=list)

    def __repr__(self) -> str:
        return f"Study {self.name}: {len(self.summary)} scenes, {len(self.rows)} landings; rows, summary"

    @staticmethod
    def read(directory: str) -> "Study":
        """Reads a study's --out directory."""
        rows = os.path.join(directory, "rows.csv")
        value = _json(directory, "summary.json")
        return Study(os.path.basename(os.path.normpath(directory)), _rows(rows), value["rows"], value["pooled"])


# Names in envelopes of earlier releases.
_FORMER = {"refused": "rejected", "refused_interval": "rejected_interval"}


@dataclasses.dataclass(repr=False)
class Envelope:
    """Relative winds and seas in which a drone lands on a boat.

    cells    for each sea state, wind (`wind_mps`, relative, 10 m above the water) and direction from which it blows
             (`from_deg`, from the bow, clockwise): `trials`, `landed`, `rejected`, `unsafe`, their 95 % intervals, and
             `class`: landed, rejected or unsafe
    rate     landing rate required up to the limit, 0 to 1
    too_few  reason why there is no limit, if too few trials were flown; otherwise None
    grid     `sea_states`, `winds_mps`, `directions`, `trials`, `seed0`
    """

    hull: str
    cells: List[Dict[str, Any]]
    rate: float
    too_few: Optional[str]
    grid: Dict[str, Any]

    def __repr__(self) -> str:
        return f"Envelope of {self.hull}: {len(self.cells)} cells, limit at a landing rate of {100 * self.rate:.0f} %; cells, grid, limit()"

    @staticmethod
    def read(directory: str) -> "Envelope":
        """Reads an envelope's --out directory."""
        return Envelope.of(_json(directory, "envelope.json"))

    @staticmethod
    def of(value: Dict[str, Any]) -> "Envelope":
        """Parses the JSON of `alight study envelope --json`."""
        cells = [{_FORMER.get(key, key): c[key] for key in c} for c in value["cells"]]
        cells = [{**c, "class": _FORMER.get(c["class"], c["class"])} for c in cells]
        return Envelope(value["hull"], cells, value["rate"], value.get("too_few"), value["grid"])

    def limit(self, sea_state: int, from_deg: float) -> Optional[float]:
        """Returns the fastest wind (m/s) up to which, from this direction in this sea state, the lower end of every cell's 95 %
        interval of the landing rate reaches `rate` and no landing was unsafe; None if not even the lightest wind qualifies."""
        along = [c for c in self.cells if c["sea_state"] == sea_state and c["from_deg"] == from_deg]
        fastest = None
        for cell in sorted(along, key=lambda c: c["wind_mps"]):
            if cell["unsafe"] or cell["landed_interval"][0] < self.rate:
                break
            fastest = cell["wind_mps"]
        return fastest


def trials(n: int, *, timeout_s: Optional[float] = None, **flags: Any) -> Trials:
    """Flies `n` landings with consecutive seeds: `alight trial --trials N`.

    Flags are those of `alight trial --help`, as in `alight.trial`: `trials(100, sea="moderate", seed0=10000)`.
    `rows=FILE.csv` also appends the rows to that file. The default of `timeout_s` (s) is ten minutes plus one minute per
    landing.
    """
    kept = flags.pop("rows", None)
    timeout_s = 60.0 * n + 600.0 if timeout_s is None else timeout_s
    with tempfile.TemporaryDirectory(prefix="alight-") as directory:
        path = os.path.join(directory, "rows.csv")
        value = _program.run(["trial"], {"trials": n, **flags, "rows": path}, timeout_s).value
        rows = _by_seed(_rows(path))
        if kept is not None:
            _append(path, os.fspath(kept))
    low, high = value["success_rate_95"]
    return Trials(rows, value, value["successes"] / value["trials"], (low, high))


def study(name, *directories: str, timeout_s: float = DAY_S, **flags: Any) -> Study:
    """Measures one quantity over many seeds: `alight study NAME`, or your own study from `FILE.toml`.

    Flags are those of `alight study --help`: `study("table2", trials=20, planners=["alight", "mpc-faa"])`. With
    `out="table2"` all files are kept there, and an interrupted study continues where it stopped; without `out` no file is
    kept. `directories` are those that `study("merge", ...)` joins. `timeout_s` is the maximum duration, s, by default a
    day.
    """
    with tempfile.TemporaryDirectory(prefix="alight-") as directory:
        out = os.fspath(flags.pop("out", None) or os.path.join(directory, "study"))
        _program.run(["study", name, *directories], {**flags, "out": out}, timeout_s)
        read = Study.read(out)
    read.name = str(name)
    return read


def envelope(*, timeout_s: float = DAY_S, **flags: Any) -> Envelope:
    """Determines the relative winds and seas in which a drone lands on a boat: `alight study envelope`.

    Flags are those of `alight study envelope --help`: `envelope(quick=True, hull="mono-5m", winds=[4, 8])`. With `out="DIR"`
    cells and rows are kept there, and an interrupted run continues where it stopped. `timeout_s` is the maximum duration, s,
    by default a day.
    """
    with tempfile.TemporaryDirectory(prefix="alight-") as directory:
        out = os.fspath(flags.pop("out", None) or os.path.join(directory, "envelope"))
        _program.run(["study", "envelope"], {**flags, "out": out}, timeout_s)
        return Envelope.read(out)


def _json(directory: str, name: str):
    path = os.path.join(directory, name)
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except (OSError, ValueError) as error:
        raise _unread(path, error) from None


def _unread(path: str, error: Exception) -> AlightError:
    return AlightError(f"reading {path}: {getattr(error, 'strerror', None) or error}")


def _rows(path: str):
    """Returns the rows of a CSV file as a DataFrame, or without pandas as dicts with the same values."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            # pandas would parse a digest that consists of digits as a number.
            rows = [{key: _value(key, text) for key, text in row.items()} for row in csv.DictReader(file)]
    except (OSError, ValueError) as error:
        raise _unread(path, error) from None
    if not pandas.is_there():
        return rows
    frame = pandas.DataFrame(rows)
    # A metric without a value in any landing is still a numeric column.
    nothing = [name for name in frame if name not in TEXTS and frame[name].isna().all()]
    return frame.astype({name: float for name in nothing})


def _value(name: Optional[str], text: Optional[str]):
    if not text:
        return None
    if name in TEXTS:
        return text
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def _by_seed(rows):
    # The program writes rows as they are ready, and threads end in any order.
    if isinstance(rows, list):
        return sorted(rows, key=lambda row: row["seed"])
    return rows.sort_values("seed", ignore_index=True)


def _append(path: str, kept: str) -> None:
    try:
        begun = os.path.exists(kept) and os.path.getsize(kept) > 0
        with open(path, encoding="utf-8") as new, open(kept, "a", encoding="utf-8") as file:
            head = new.readline()
            file.write(("" if begun else head) + new.read())
    except OSError as error:
        raise AlightError(f"appending rows to {kept}: {error.strerror or error}") from None
