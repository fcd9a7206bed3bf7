"""Text tables of any program by pandas: separators, quoted cells, decimal commas, comments, names with units, clocks.

Ambiguous content is not converted: a column without a unit, dates that may begin with the day or the month, two kinds of
decimals. The notes list assumptions and omissions.
"""

from __future__ import annotations

import csv
import os
from typing import Dict, List, NamedTuple, Optional, Tuple

from .._lazy import numpy as np
from .._lazy import pandas
from .._program import AlightError
from ._frame import MAX_ROWS, Converted
from ._names import Name, name
from ._times import clock, epoch_unit, resolve, spread

MAX_BYTES = 512 << 20
# Maximum number of lines before the header.
MAX_PREAMBLE = 100
COMMENTS = ("#", "%", "//")
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "vertical bars", " ": "spaces"}
MISSING = ["", "nan", "na", "n/a", "null", "none", "-", "--", "nan(ind)"]
# Speed below which no course is needed, m/s.
STILL_MPS = 0.3


class _Header(NamedTuple):
    """A line read as a header: its number from 0, separator, cells, names, and whether it is a comment."""

    line: int
    separator: str
    cells: List[str]
    names: List[Optional[Name]]
    remark: bool

    def rank(self) -> Tuple:
        known = [n for n in self.names if n and n.name != "t_s"]
        return (self.timed(), sum(n.factor is not None for n in known), len(known), min(len(self.names), 2))

    def timed(self) -> bool:
        return any(n and n.name == "t_s" for n in self.names)


def read(path: str, _system) -> Converted:
    """Reads a table."""
    if os.path.getsize(path) > MAX_BYTES:
        raise AlightError(f"{path}: more than {MAX_BYTES >> 20} MB; cut the table into parts", 2)
    with open(path, "rb") as file:
        data = file.read()
    converted = Converted("table")
    lines = _decoded(data, converted).splitlines()
    header = _header(path, lines)
    header, begin = _with_units(lines, header, converted)
    columns = _columns(path, header, converted)
    cells = _cells(path, lines, header, begin, converted)
    values = _values(path, cells, header, columns, converted)
    _add(path, values, converted)
    return converted


def _error(path: str, line: int, message: str) -> AlightError:
    return AlightError(f"{path}, line {line + 1}: {message}", 2)


def _decoded(data: bytes, converted: Converted) -> str:
    """Decodes the text: UTF-8, UTF-16 with a byte order mark, or Latin-1."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", "replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        converted.notes.append("the text is no UTF-8 and was read as Latin-1")
        return data.decode("latin-1")


def _comment(line: str) -> Optional[str]:
    """Content of a comment line; None for any other line."""
    line = line.lstrip()
    return line.lstrip("#%/ ") if line.startswith(COMMENTS) else None


def _split(line: str, separator: str) -> List[str]:
    if separator == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        # A cell of 128 kB is not a measurement.
        return []


def _as_header(k: int, line: str) -> _Header:
    """Splits the line by the separator that yields the most known names."""
    remark = _comment(line)
    text = line if remark is None else remark
    ways = []
    for separator in SEPARATORS:
        cells = _split(text, separator)
        # A line may end with its separator.
        while cells and not cells[-1]:
            cells.pop()
        ways.append(_Header(k, separator, cells, [name(cell) for cell in cells], remark is not None))
    return max(ways, key=_Header.rank)


def _header(path: str, lines: List[str]) -> _Header:
    """First line with a time and another quantity; certain matches precede likely ones."""
    first = [(k, line) for k, line in enumerate(lines) if line.strip()][:MAX_PREAMBLE]
    headers = [_as_header(k, line) for k, line in first]
    certain = next((h for h in headers if h.timed() and h.rank()[1]), None)

    def is_likely(h: _Header) -> bool:
        prose = h.separator == " " and len(h.names) > h.rank()[2] + 1
        return bool(h.timed() and h.rank()[2] and not prose)

    header = certain or next((h for h in headers if is_likely(h)), None)
    if header is None:
        shown = next((h for h in headers if not h.remark), None)
        if shown is None:
            raise AlightError(f"{path}: no line of columns", 2)
        what = "column `t_s` is missing" if not shown.timed() else "no column is known but the time"
        cells = ", ".join(f"`{cell[:40]}`" for cell in shown.cells[:20])
        raise _error(path, shown.line, f"{what}; it holds {cells} (cells separated by {SEPARATORS[shown.separator]})")
    return header


def _with_units(lines: List[str], header: _Header, converted: Converted) -> Tuple[_Header, int]:
    """Header with the units of a separate line below it, and the first line of the rows."""
    passed = sum(1 for line in lines[: header.line] if line.strip() and _comment(line) is None and not _is_separator_line(line))
    if passed:
        converted.notes.append(f"{passed} lines before the header, which is line {header.line + 1}, were passed over")
    if header.remark:
        converted.notes.append(f"the header is the remark in line {header.line + 1}")
    if header.separator != ",":
        converted.notes.append(f"the cells are separated by {SEPARATORS[header.separator]}")
    below = next((k for k in range(header.line + 1, len(lines)) if lines[k].strip()), None)
    if below is None or _comment(lines[below]) is not None:
        return header, header.line + 1
    units = [unit.strip("[]() ") for unit in _split(lines[below], header.separator)]
    is_value = any(any(c.isdigit() for c in unit) and "/" not in unit for unit in units)
    if len(units) == len(header.cells) and not is_value:
        names = [name(f"{cell} [{unit}]") if unit else name(cell) for cell, unit in zip(header.cells, units)]
        stated = [sum(n is not None and n.factor is not None for n in of) for of in (header.names, names)]
        if stated[1] > stated[0]:
            converted.notes.append(f"the units are those of line {below + 1}")
            return header._replace(names=names), below + 1
    return header, header.line + 1


def _is_separator_line(line: str) -> bool:
    """`sep=;`, a line that spreadsheets write."""
    return line.strip().strip('"').lower().startswith("sep=")


def _columns(path: str, header: _Header, converted: Converted) -> Dict[str, int]:
    """Column number of each quantity."""
    times = [k for k, n in enumerate(header.names) if n and n.name == "t_s"]
    own = [k for k in times if header.cells[k] == "t_s"]
    if len(own) > 1:
        raise _error(path, header.line, "column `t_s` appears twice")
    stated = [k for k in times if header.names[k].factor is not None]
    time = (own or stated or times)[0]
    unclear = [
        f"unknown column `{cell}`: it states no unit that is known; call it `{n.name}` where it is that"
        for cell, n in zip(header.cells, header.names)
        if n and n.factor is None and n.name != "t_s"
    ]
    if unclear:
        missing = [] if header.names[time].factor else [f"column `t_s` is missing (`{header.cells[time]}` states no unit)"]
        raise _error(path, header.line, "; ".join(missing + unclear))
    columns = {"t_s": time}
    for k, n in enumerate(header.names):
        if n and n.name != "t_s":
            if n.name in columns:
                raise _error(path, header.line, f"column `{n.name}` appears twice")
            columns[n.name] = k
    renamed = [f"`{header.cells[k]}` as {own_name}" for own_name, k in columns.items() if header.cells[k] != own_name]
    if renamed:
        converted.notes.append(f"columns are read as Alight's own (roll starboard down, pitch bow up, heave up): {', '.join(renamed)}")
    left_out = [cell for k, cell in enumerate(header.cells) if k not in columns.values() and cell]
    if left_out:
        converted.notes.append(f"columns that are not read: {', '.join(left_out)}")
    return columns


def _cells(path: str, lines: List[str], header: _Header, begin: int, converted: Converted):
    """Cells of the rows as text, indexed by line number."""
    head = lines[header.line].strip()
    numbers = [k for k in range(begin, len(lines)) if lines[k].strip(" \t\r,;|")]
    rows = [k for k in numbers if _comment(lines[k]) is None and lines[k].strip() != head]
    if len(rows) < len(numbers):
        converted.notes.append(f"{len(numbers) - len(rows)} remarks and repeated headers between the rows are passed over")
    if not rows:
        raise _error(path, header.line, "no row is below the header")
    if len(rows) > MAX_ROWS:
        raise AlightError(f"{path}: more than {MAX_ROWS} rows; cut the table into parts", 2)
    width, kept, lacking = len(header.cells), [], []
    for k in rows:
        row = _split(lines[k], header.separator)
        if any(row[width:]):
            quotes = "; numbers with a decimal comma need quotes here" if header.separator == "," else ""
            raise _error(path, k, f"{len(row)} values for {width} columns{quotes}")
        (kept if len(row) >= width else lacking).append((k, row[:width]))
    if len(lacking) > len(rows) // 2:
        raise _error(path, lacking[0][0], f"{len(lacking[0][1])} values for {width} columns; more than half of the rows cannot be used")
    if lacking:
        converted.notes.append(f"line {lacking[0][0] + 1} and {len(lacking) - 1} more rows with too few values are left out")
    return pandas.DataFrame([row for _, row in kept], index=[k for k, _ in kept], columns=range(width), dtype=str)


def _values(path: str, cells, header: _Header, columns: Dict[str, int], converted: Converted):
    """Numbers of the columns in canonical units; rows that cannot be read are counted and omitted."""
    texts = {own: cells[k] for own, k in columns.items()}
    clocks = texts["t_s"].str.contains(":").any()
    numeric = [own for own in texts if not (own == "t_s" and clocks)]
    comma, point = (_first_with(sign, [texts[own] for own in numeric]) for sign in ",.")
    if comma is not None and point is not None:
        raise _error(
            path,
            max(comma, point),
            f"numbers have a decimal comma in line {comma + 1} and a decimal point in line {point + 1}; write all in one way",
        )
    if comma is not None:
        converted.notes.append("numbers have a decimal comma")
    values, bad = pandas.DataFrame(index=cells.index), pandas.Series("", index=cells.index)
    for own in numeric:
        known = ~texts[own].str.lower().isin(MISSING)
        number = pandas.to_numeric(texts[own].str.replace(",", ".", n=1, regex=False).where(known, "nan"), errors="coerce")
        wrong = (known | (own == "t_s")) & number.isna()
        bad = bad.where(~wrong | (bad != ""), own + " is `" + texts[own] + "`, not a number")
        values[own] = number
    if clocks:
        values["t_s"] = _clocks(path, texts["t_s"], bad)
    else:
        values["t_s"] *= _time_unit(path, header, columns["t_s"], values["t_s"], converted)
    is_bad = bad != ""
    if is_bad.any():
        line, why = int(bad.index[is_bad][0]), bad[is_bad].iloc[0]
        if is_bad.sum() > len(bad) // 2:
            raise _error(path, line, f"{why}; more than half of the rows cannot be used")
        converted.notes.append(f"line {line + 1} and {int(is_bad.sum()) - 1} more rows left out: {why}")
    for own, k in columns.items():
        if own != "t_s":
            values[own] *= header.names[k].factor
    return values[~is_bad]


def _first_with(sign: str, columns) -> Optional[int]:
    """First line with this character in one of the columns."""
    found = [texts.index[texts.str.contains(sign, regex=False)] for texts in columns]
    return min((int(lines[0]) for lines in found if len(lines)), default=None)


def _clocks(path: str, texts, bad):
    """Times (s) from clocks; marks rows without a time in `bad`."""
    read_clocks = [clock(text) for text in texts]
    known = np.array([c is not None for c in read_clocks])
    message = "t_s is `" + texts + "`, no time; 2026-05-20T12:00:00.1Z and 12:00:00.1 are read"
    bad.mask(~known & (bad == ""), message, inplace=True)
    try:
        times = resolve([c for c in read_clocks if c is not None])
    except ValueError as error:
        raise AlightError(f"{path}: {error}", 2) from None
    out = np.full(len(texts), np.nan)
    out[known] = times
    return out


def _time_unit(path: str, header: _Header, column: int, t, converted: Converted) -> float:
    """Length of the time's unit, s, from its name or the size of the values."""
    factor = header.names[column].factor
    if factor is not None:
        return factor
    known = t.dropna()
    unit = epoch_unit(float(known.iloc[0])) if len(known) else None
    if unit is None:
        called = header.cells[column]
        raise _error(
            path,
            header.line,
            f"column `t_s` is missing: the unit of the time `{called}` is not stated; call it t_s, {called}_ms or {called}_us where it "
            "is that",
        )
    converted.notes.append(f"the times are {unit[1]} since 1970, as their size says")
    return unit[0]


def _add(path: str, values, converted: Converted) -> None:
    """Converts speeds and courses to velocities; spreads coarse stamps, separately for each set of quantities that arrive
    together."""
    if "sog_mps" in values or "cog_deg" in values:
        _velocities(values, converted)
    names = [own for own in values.columns if own != "t_s"]
    there = values[names].notna()
    noted = set()
    for group in _groups(there):
        part = values[there[group].any(axis=1)]
        try:
            t, keep, note = spread(part["t_s"])
        except ValueError as error:
            raise _error(path, int(part.index[0]), str(error)) from None
        if note and note not in noted:
            noted.add(note)
            converted.notes.append(note)
        order = np.arange(len(part))[keep]
        back = np.flatnonzero(np.diff(t[keep]) < 0.0)
        if len(back):
            converted.notes.append(f"the time goes back in line {int(part.index[order[back[0] + 1]]) + 1}: the rows are sorted by time")
        converted.add(t[keep], **{own: part[own].to_numpy()[keep] for own in group})


def _groups(there) -> List[List[str]]:
    """Sets of quantities that share rows."""
    groups: List[set] = []
    for row in there.drop_duplicates().to_numpy():
        own = {there.columns[k] for k in np.flatnonzero(row)}
        if not own:
            continue
        shared = [group for group in groups if group & own]
        groups = [group for group in groups if not group & own] + [own.union(*shared)]
    return [[own for own in there.columns if own in group] for group in groups]


def _velocities(values, converted: Converted) -> None:
    """Replaces speed and course over ground by velocities north and east, unless these are measured themselves."""
    nothing = pandas.Series(np.nan, index=values.index)
    speed = values.pop("sog_mps") if "sog_mps" in values else nothing
    course = values.pop("cog_deg") if "cog_deg" in values else nothing
    course = course.where(course.notna() | ~(speed < STILL_MPS), 0.0)
    for own, part in (("north_mps", np.cos), ("east_mps", np.sin)):
        made = speed * part(np.radians(course))
        values[own] = values[own].fillna(made) if own in values else made
    alone = int((speed.notna() ^ course.notna()).sum())
    if alone:
        converted.notes.append(f"{alone} speeds or courses over ground without the other are left out")
