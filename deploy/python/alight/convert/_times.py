"""Times of rows: seconds in any unit, counts since 1970, or clocks with or without a date; stamps coarser than the rows."""

from __future__ import annotations

import datetime
import re
from typing import List, NamedTuple, Optional, Tuple

from .._lazy import numpy as np

DAY_S = 86_400.0
# Step back beyond which a clock has passed midnight, s.
MIDNIGHT_S = 43_200.0
# Fraction of rows with the previous row's stamp above which stamps count as coarse.
COARSE = 0.2
# Tolerance on the number of rows per stamp, as a fraction plus one row; maximum fraction of rows omitted for it.
EVEN, LEFT_OUT = 0.2, 0.2
CLOCK = re.compile(
    r"^(?:(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})[ T_,]+|(?P<a>\d{1,2})(?P<sep>[-/.])(?P<b>\d{1,2})[-/.](?P<y2>\d{4})[ T_,]+)?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{1,2})(?::(?P<second>\d{1,2}(?:[.,]\d*)?))?"
    r"\s*(?P<half>am|pm)?\s*(?:z|utc|gmt)?\s*(?P<sign>[+-])?(?(sign)(?P<zh>\d{1,2}):?(?P<zm>\d{2})?)$",
    re.IGNORECASE,
)
EPOCH_UNITS = ((1.0, "seconds"), (1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds"))


class Clock(NamedTuple):
    """Time of day (s; in UTC if a zone is given) and day: a number, or the year and two numbers that may be day or month, or
    None."""

    of_day: float
    day: object


def epoch_unit(value: float) -> Optional[Tuple[float, str]]:
    """Unit of a count since 1970 (from 2001 to 2286), by its size: length in s, and name."""
    return next((unit for unit in EPOCH_UNITS if 1e9 <= value * unit[0] < 1e10), None)


def clock(text: str) -> Optional[Clock]:
    """Parses `2026-05-20T12:00:00.10Z`, `20.05.2026 12:00:00`, `12:00:00,1`, `1:02:03 PM`; None for anything else."""
    found = CLOCK.match(text.strip())
    if not found:
        return None
    hour, minute = int(found["hour"]), int(found["minute"])
    second = float((found["second"] or "0").replace(",", "."))
    if found["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if found["half"].lower() == "pm" else 0)
    # 60 is a leap second.
    if hour > 23 or minute > 59 or second >= 61.0:
        return None
    of_day = (hour * 60 + minute) * 60 + second
    if found["sign"]:
        zone = 60.0 * (60 * int(found["zh"]) + int(found["zm"] or 0))
        of_day -= zone if found["sign"] == "+" else -zone
    day = None
    if found["y"]:
        day = day_number(int(found["y"]), int(found["m"]), int(found["d"]))
    elif found["y2"]:
        a, b, year = int(found["a"]), int(found["b"]), int(found["y2"])
        if found["sep"] == ".":
            day = day_number(year, b, a)
        elif day_number(year, a, b) is not None or day_number(year, b, a) is not None:
            day = (a, b, year)
    dated = found["y"] or found["y2"]
    return None if dated and day is None else Clock(of_day, day)


def day_number(year: int, month: int, day: int) -> Optional[int]:
    """Days since 1970; None for a date that does not exist between 1970 and 2199."""
    try:
        number = datetime.date(year, month, day).toordinal() - datetime.date(1970, 1, 1).toordinal()
    except ValueError:
        return None
    return number if 1970 <= year < 2200 else None


def resolve(clocks: List[Clock]) -> List[float]:
    """Times, s, in the order of the rows; a ValueError names the ambiguity. Clocks without a date continue past midnight."""
    either = [c.day for c in clocks if isinstance(c.day, tuple)]
    day_first, month_first = any(d[0] > 12 for d in either), any(d[1] > 12 for d in either)
    known = day_first != month_first
    if not known and len(set(either)) > 1:
        a, b, year = next(d for d in either if d != either[0])
        raise ValueError(f"the date {a}/{b}/{year} may begin with its day or its month; write dates as year-month-day")
    times, days, before = [], 0.0, float("-inf")
    for of_day, day in clocks:
        if day is None:
            if of_day + days < before - MIDNIGHT_S:
                days += DAY_S
            before = of_day + days
            times.append(before)
            continue
        if isinstance(day, tuple):
            a, b, year = day
            number = day_number(year, b, a) if day_first else day_number(year, a, b)
            # Every row has the same day, and the order of day and month is unknown.
            number = number if known else 0
            if number is None:
                raise ValueError(f"{a}/{b}/{year} is no date as the others are written")
            day = number
        times.append(day * DAY_S + of_day)
    return times


def spread(t) -> Tuple[object, object, Optional[str]]:
    """Times of rows whose stamps are coarser than the rows; the rows to keep; a description for users.

    A logger that writes rows evenly and stamps them with the step q of a coarse clock writes floor(t / q) q. A line of stamp over
    row number recovers the times, to within a constant below q. A ValueError gives the reason why no row can be dated.
    """
    t = np.asarray(t, dtype=float)
    keep = np.ones(len(t), dtype=bool)
    first = np.flatnonzero(np.concatenate([[True], np.diff(t) != 0.0])) if len(t) else np.array([], dtype=int)
    count = np.diff(np.append(first, len(t)))
    repeated = len(t) - len(first)
    if len(first) < 3 or repeated < COARSE * len(t):
        return t, keep, None
    stamps = t[first]
    usual, steps = float(np.median(count)), np.diff(stamps)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    edge = np.zeros(len(first), dtype=bool)
    edge[[0, -1]] = count[[0, -1]] < usual
    even = (np.abs(count - usual) <= 1.0 + EVEN * usual) | edge
    out = int(count[~even].sum())
    if out > LEFT_OUT * len(t) or step <= 0.0:
        raise ValueError(
            f"the times go in steps of {step:.3f} s with {count.min()} to {count.max()} rows at one time, so that no row can be "
            "dated; record times with fractions of a second"
        )
    # Runs of consecutive stamps.
    follows = np.concatenate([[False], (steps > 0) & (steps < 1.5 * step)])
    follows[1:] &= even[:-1]
    new = t.copy()
    begins = np.flatnonzero(even & ~follows)
    for begin in begins:
        end = begin + 1
        while end < len(first) and even[end] and follows[end]:
            end += 1
        _date(new, t, (first[begin], first[end - 1] + count[end - 1]), (first[begin:end], count[begin:end]), (step, usual))
    keep = np.repeat(even, count)
    note = (
        f"the times go in steps of {step:.3f} s, with {usual:.0f} rows at one time: the rows are spread evenly over the step, and may "
        "be off by so much"
    )
    if out:
        note += f"; {out} rows at times with fewer or more rows are left out"
    return new, keep, note


def _date(new, t, rows, runs, steps) -> None:
    """Dates the rows of a run by a line; if the line does not fit within a step, spreads each stamp's rows evenly."""
    (a, b), (first, count), (step, usual) = rows, runs, steps
    stamps = t[a:b]
    k = np.arange(b - a) - 0.5 * (b - a - 1)
    # One or two stamps do not determine a slope.
    slope = float(k @ (stamps - stamps[0]) / (k @ k)) if len(first) > 2 else step / usual
    line = stamps[0] + (stamps - stamps[0]).mean() + slope * k
    if slope > 0.0 and (np.abs(stamps - line) <= step).all():
        new[a:b] = line + 0.5 * (step - slope)
    else:
        within = np.arange(b - a) - np.repeat(first - a, count)
        new[a:b] = stamps + step * within / np.repeat(count, count)
