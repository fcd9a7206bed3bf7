"""Recordings of other programs and devices as Alight's CSV, which `alight estimate` reads.

    python -m alight.convert boat.ulg             # writes boat.csv
    python -m alight.convert boat.csv -o kai.csv  # a table of any program

ULog of PX4 (`.ulg`), DataFlash logs (`.bin`) and telemetry logs (`.tlog`) of ArduPilot and others, bags of ROS 1 and 2, INSPVAA,
INSPVASA and VNINS sentences in text, and tables of any program. NMEA 0183 and UBX need no conversion. A NetCDF of
Capytaine becomes the table that `alight trial --hull` reads. The libraries that read them are the extra `convert` of the wheel.
"""

from __future__ import annotations

import os
import re
from typing import Optional, Sequence

from .._program import AlightError
from ._frame import Converted

# Magic bytes of compressed files, with the program that unpacks each.
PACKED = (
    (b"\x1f\x8b", "gunzip"),
    (b"PK\x03\x04", "unzip"),
    (b"\x28\xb5\x2f\xfd", "unzstd"),
    (b"\xfd7zXZ\0", "unxz"),
    (b"BZh", "bunzip2"),
)
# Contents of formats that the program reads by itself: each format has only one reader.
OWN = (
    (rb"\xb5\x62", "UBX"),
    (rb"\$[A-Z]{4,6},|!PDGY,", "NMEA 0183"),
    (rb"(?m)^ *\(\d+\.\d+\) +\w*can\d|^[\d:.ZT-]+,[0-7],\d{5,6},\d+,\d+,\d+,|^\d\d:\d\d:\d\d\.\d+ [RT] [0-9A-F]{8} ", "NMEA 2000"),
    (rb'"updates" *: *\[', "Signal K"),
)
HEAD_BYTES = 16 << 10

__all__ = ["Converted", "convert"]


def convert(
    path, out: Optional[str] = None, *, system: Optional[int] = None, topics: Sequence[str] = (), axes: Optional[str] = None
) -> Converted:
    """Converts one recording, writes its CSV, and returns its content.

    `path` is a file, or the directory of a ROS 2 bag. `out` is the CSV [default: the recording's name with `.csv`].
    `system` is the MAVLink system of the vessel in a telemetry log [default: the one with the most attitudes]. `topics` are topics
    of a bag that are used [default: the best of each kind by type, frame and name], and `axes` those of its headings, enu or
    compass [default: those that the course over ground confirms]. A recording that
    cannot be converted raises an AlightError with code 2; a missing library raises an ImportError that names it.
    """
    path = os.fspath(path)
    out = os.fspath(out) if out is not None else _default_out(path)
    if os.path.exists(out) and os.path.exists(path) and os.path.samefile(out, path):
        raise AlightError(f"{out}: the CSV would replace the recording; name another file by -o", 2)
    try:
        read = _reader(path, _head(path))
        if topics or axes is not None:
            if not read.__module__.endswith("._bags"):
                raise AlightError(f"{path}: no bag of ROS; only a bag has topics and axes", 2)
            converted = read(path, system, topics, axes)
        else:
            converted = read(path, system)
        converted.write(path, out)
    except KeyError as error:
        raise AlightError(f"{path}: the recording has no field {error}, which is converted; it is damaged or of an unknown version", 2) from None
    except OSError as error:
        raise AlightError(f"converting {path} to {out}: {error}; check the paths and their permissions", 2) from None
    return converted


def _default_out(path: str) -> str:
    stem, suffix = os.path.splitext(path.rstrip(os.sep))
    return stem + (".alight.csv" if suffix.lower() == ".csv" else ".csv")


def _head(path: str) -> bytes:
    if os.path.isdir(path):
        return b""
    with open(path, "rb") as file:
        return file.read(HEAD_BYTES)


def _reader(path: str, head: bytes):
    """Returns the function that reads this recording, determined by its first bytes."""
    # Each reader is imported only for its own files, so that no reader needs another's libraries.
    if os.path.isdir(path) or head.startswith((b"#ROSBAG V", b"SQLite format 3\0", b"\x89MCAP0\r\n")):
        from ._bags import read
    elif head.startswith((b"\x89HDF\r\n\x1a\n", b"CDF")):
        from ._capytaine import read
    elif head.startswith(b"ULog\x01\x12\x35"):
        from ._ulog import read
    elif head.startswith(b"\xa3\x95"):
        from ._mavlink import read_dataflash as read
    elif _is_tlog(head):
        from ._mavlink import read_tlog as read
    elif any(name in head for name in (b"#INSPVAA,", b"%INSPVASA,", b"$VNINS,")):
        from ._receivers import read_sentences as read
    else:
        _refuse(path, head)
        from ._table import read
    return read


def _refuse(path: str, head: bytes) -> None:
    """Returns an error for a file that is not a recording of another program."""
    if not head:
        raise AlightError(f"{path}: the file is empty", 2)
    for begin, tool in PACKED:
        if head.startswith(begin):
            raise AlightError(f"{path}: the file is packed; first {tool} it", 2)
    for content, name in OWN:
        if re.search(content, head):
            raise AlightError(f"{path}: a log of {name}; `alight estimate {path}` reads it as it is, and leaves out what its sender marks", 2)


def _is_tlog(head: bytes) -> bool:
    # Microseconds from 2001 to 2286 precede a MAVLink packet.
    return len(head) > 8 and head[8] in (0xFE, 0xFD) and 10**15 <= int.from_bytes(head[:8], "big") < 10**16
