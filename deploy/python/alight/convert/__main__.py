"""The command `python -m alight.convert`."""

from __future__ import annotations

import argparse
import sys
from typing import List, Optional

from .._program import AlightError
from . import convert


def main(words: Optional[List[str]] = None) -> int:
    """Runs the command; returns its exit code: 0 converted, 2 bad input or a missing library."""
    parser = argparse.ArgumentParser(
        prog="python -m alight.convert",
        description="Converts a recording of another program or device to Alight's CSV, which `alight estimate` reads, or a hull "
        "of Capytaine to the table that `alight trial --hull` reads.",
    )
    parser.add_argument("file", metavar="FILE", help="ULog, DataFlash, tlog, bag of ROS, INSPVA or VNINS text, NetCDF of Capytaine, or any table")
    parser.add_argument("-o", dest="out", metavar="OUT.csv", help="the CSV [default: FILE with the suffix .csv]")
    system = "MAVLink system of the vessel in a tlog [default: the one with the most attitudes]"
    parser.add_argument("--system", type=int, metavar="N", help=system)
    topic = "use this topic of a bag of ROS [default: the best of each kind by type, frame and name]; may be given several times"
    parser.add_argument("--topic", dest="topics", action="append", default=[], metavar="NAME", help=topic)
    axes = "axes of headings in a bag: REP 103, or a compass's, clockwise from north [default: as the course over ground confirms]"
    parser.add_argument("--axes", choices=("enu", "compass"), help=axes)
    args = parser.parse_args(words)
    try:
        converted = convert(args.file, args.out, system=args.system, topics=args.topics, axes=args.axes)
    except (AlightError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for note in converted.notes:
        print(f"{args.file}: {note}", file=sys.stderr)
    print(f"{converted.out}: {converted.summary()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
