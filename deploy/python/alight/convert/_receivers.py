"""Receivers: INSPVAA and INSPVASA of NovAtel and VNINS of VectorNav as text."""

from __future__ import annotations

import collections
import io
import os
import re
import zlib
from typing import Dict, List, Optional

from .._program import AlightError
from ._frame import Converted

WEEK_S = 604_800.0
# Maximum length of a line that is parsed, characters; these sentences have about 250.
MAX_LINE = 4096
MAX_BYTES = 512 << 20

NOVATEL = re.compile(r"[#%](INSPVAA|INSPVASA),([^*]*)\*([0-9a-fA-F]{8})")
VECTORNAV = re.compile(r"\$(VNINS,[^*]*)\*([0-9a-fA-F]{2})")
INS_NAMES = ("latitude_deg", "longitude_deg", "altitude_m", "north_mps", "east_mps", "down_mps", "roll_deg", "pitch_deg", "heading_deg")


class _Rows:
    """Values by column and kind of message."""

    def __init__(self):
        self._kinds: Dict[str, Dict[str, List[float]]] = collections.defaultdict(lambda: collections.defaultdict(list))

    def add(self, kind: str, t_s: float, **values: float) -> None:
        for name, value in {"t_s": t_s, **values}.items():
            self._kinds[kind][name].append(value)

    def give(self, converted: Converted) -> None:
        for columns in self._kinds.values():
            converted.add(**columns)


def read_sentences(path: str, _system) -> Converted:
    """Reads the sentences of a text, ignoring what a logger wrote around them."""
    if os.path.getsize(path) > MAX_BYTES:
        raise AlightError(f"{path}: more than {MAX_BYTES >> 20} MB; cut the recording into parts", 2)
    converted, rows = Converted("INS sentences"), _Rows()
    damaged = unaligned = 0
    with io.open(path, encoding="latin-1", newline=None) as file:
        for line in file:
            line = line[:MAX_LINE]
            found = _novatel(line) or _vectornav(line)
            if found is None:
                # A sentence begins, but its checksum is wrong or it is cut off.
                damaged += any(name in line for name in ("#INSPVAA,", "%INSPVASA,", "$VNINS,"))
                continue
            t_s, values, aligned = found
            if aligned:
                rows.add("ins", t_s, **dict(zip(INS_NAMES, values)))
            else:
                unaligned += 1
    for count, why in ((damaged, "damaged"), (unaligned, "without a solution")):
        if count:
            converted.notes.append(f"{count} sentences {why} are left out")
    rows.give(converted)
    return converted


def _numbers(fields: List[str]) -> Optional[List[float]]:
    try:
        return [float(field) for field in fields]
    except ValueError:
        return None


def _novatel(line: str) -> Optional[tuple]:
    """INSPVAA and INSPVASA (OEM7 manual): GPS time (s), values by `INS_NAMES`, whether the INS is aligned."""
    match = NOVATEL.search(line)
    if not match:
        return None
    body = f"{match.group(1)},{match.group(2)}"
    # The CRC is Ethernet's without the inversions at the beginning and the end.
    if zlib.crc32(body.encode("latin-1"), 0xFFFFFFFF) ^ 0xFFFFFFFF != int(match.group(3), 16):
        return None
    fields = body.rpartition(";")[2].split(",")
    values = _numbers(fields[:11]) if len(fields) >= 12 else None
    if values is None:
        return None
    week, seconds, latitude, longitude, height, north, east, up, roll, pitch, azimuth = values
    aligned = fields[11] in ("INS_SOLUTION_GOOD", "INS_ALIGNMENT_COMPLETE", "INS_SOLUTION_FREE", "INS_HIGH_VARIANCE")
    return week * WEEK_S + seconds, (latitude, longitude, height, north, east, -up, roll, pitch, azimuth), aligned


def _vectornav(line: str) -> Optional[tuple]:
    """VNINS (VN-200 manual), with the same result; the INS is aligned in modes 1 and 2 of its status."""
    match = VECTORNAV.search(line)
    if not match:
        return None
    total = 0
    for char in match.group(1).encode("latin-1"):
        total ^= char
    fields = match.group(1).split(",")
    numbers = _numbers([*fields[1:3], *fields[4:13]]) if len(fields) >= 13 else None
    if total != int(match.group(2), 16) or numbers is None:
        return None
    seconds, week, yaw, pitch, roll, latitude, longitude, altitude, north, east, down = numbers
    try:
        aligned = int(fields[3], 16) & 3 in (1, 2)
    except ValueError:
        return None
    return week * WEEK_S + seconds, (latitude, longitude, altitude, north, east, down, roll, pitch, yaw % 360.0), aligned
