"""Quantities and units of columns, from their names.

A name is a quantity and a unit: `roll_deg`, `Roll (deg)`, `"Heave [m]"`, `acc_x [m/s²]`, `vel_n_m_s`. A quantity without a unit
is not converted: a roll of 0.2 may be degrees or radians.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple, Optional, Tuple

# Canonical name, dimension, and other names in lower-case letters and digits.
KNOWN = (
    ("roll_deg", "angle", "roll rollangle"),
    ("pitch_deg", "angle", "pitch pitchangle"),
    ("heading_deg", "angle", "heading hdg headingtrue trueheading hdt"),
    ("heave_m", "length", "heave"),
    ("surge_m", "length", "surge"),
    ("sway_m", "length", "sway"),
    *((f"gyro_{a}_radps", "rate", f"gyro{a} gyr{a} gyroscope{a} angularrate{a} angularvelocity{a}") for a in "xyz"),
    *((f"accel_{a}_mps2", "acceleration", f"accel{a} acc{a} accelerometer{a} acceleration{a} specificforce{a}") for a in "xyz"),
    ("latitude_deg", "angle", "latitude lat"),
    ("longitude_deg", "angle", "longitude lon lng long"),
    ("altitude_m", "length", "altitude alt height ellipsoidalheight hae"),
    *((f"{w}_mps", "speed", f"{w} vel{w[0]} v{w[0]} vel{w} v{w} velocity{w} {w}velocity") for w in ("north", "east", "down")),
    # Speed and course over ground are converted to velocities north and east.
    ("sog_mps", "speed", "sog speedoverground"),
    ("cog_deg", "angle", "cog courseoverground"),
)
QUANTITIES = {other: (name, dimension) for name, dimension, others in KNOWN for other in others.split()}
TIMES = set(
    "t time timestamp ts elapsed elapsedtime utc utctime timeutc gpstime datetime dateandtime dateutc datetimeutc localtime "
    "logtime sampletime unixtime epoch epochtime".split()
)
# Units of a dimension in letters and digits (`m/s²` is `ms2`), with factors to the units of the canonical names.
UNITS = {
    "angle": (
        ("deg degs degree degrees degt degtrue decimaldegrees decdeg", 1.0),
        ("rad rads radian radians", 180.0 / math.pi),
        ("mrad", 0.18 / math.pi),
    ),
    "length": (
        ("m meter meters metre metres", 1.0),
        ("cm centimeter centimeters centimetre centimetres", 1e-2),
        ("mm millimeter millimeters millimetre millimetres", 1e-3),
        ("ft foot feet", 0.3048),
    ),
    "rate": (
        ("radps rads radsec radpersec radianss", 1.0),
        ("degps degs dps degsec degpersec degreess", math.pi / 180.0),
    ),
    "acceleration": (("mps2 ms2 mss msec2", 1.0), ("g", 9.80665), ("mg", 9.80665e-3)),
    "speed": (("mps ms msec", 1.0), ("kn kt kts kns knot knots", 1852.0 / 3600.0), ("kmh kph", 1.0 / 3.6)),
    "time": (
        ("s sec secs second seconds", 1.0),
        ("ms msec millis millisecond milliseconds", 1e-3),
        ("us usec micros microsecond microseconds", 1e-6),
        ("ns nsec nanos nanosecond nanoseconds", 1e-9),
    ),
}
FACTORS = {dimension: {unit: f for units, f in all_units for unit in units.split()} for dimension, all_units in UNITS.items()}
BRACKETS = re.compile(r"^(.*)(?:\[([^\]]*)\]|\(([^)]*)\)|\{([^}]*)\}|<([^>]*)>)$")


class Name(NamedTuple):
    """Meaning of a column's name. `name` is the canonical name of the quantity, or `t_s`; `factor` is None if no known unit is
    stated."""

    name: str
    factor: Optional[float]


def _words(text: str) -> list:
    """Lower-case words of letters and digits: `RollAngle_deg` becomes `roll angle deg`."""
    for sign, letters in (("°", " deg"), ("º", " deg"), ("²", "2"), ("µ", "u"), ("μ", "u"), ("^", "")):
        text = text.replace(sign, letters)
    text = re.sub(r"([a-z])([A-Z])", r"\1 \2", text)
    return re.findall(r"[a-z0-9]+", text.lower())


def _quantity(base: str) -> Optional[Tuple[str, str]]:
    return ("t_s", "time") if base in TIMES else QUANTITIES.get(base)


def name(text: str) -> Optional[Name]:
    """Meaning of a column's name; None if the name is unknown."""
    text = text.strip()
    match = BRACKETS.match(text)
    if match:
        base = "".join(_words(match.group(1)))
        unit = "".join(_words(next(group for group in match.groups()[1:] if group is not None)))
        found = _quantity(base)
        if found:
            return Name(found[0], FACTORS[found[1]].get(unit))
    # The unit is in the last words; the brackets may also contain part of the name.
    words = _words(text)
    for end in range(len(words) - 1, 0, -1):
        found = _quantity("".join(words[:end]))
        factor = FACTORS[found[1]].get("".join(words[end:])) if found else None
        if factor is not None:
            return Name(found[0], factor)
    found = _quantity("".join(words))
    return Name(found[0], None) if found else None
