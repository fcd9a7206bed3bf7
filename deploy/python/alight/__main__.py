"""Draws what the program has written: the --out of a study or an envelope, a recording, a flight.

    python3 -m alight PATH [FILE.svg]      without FILE: PATH.svg; other endings (.pdf, .png) work, too
"""

import os
import sys

from . import AlightError, Envelope, Study, plots, read


def figure(path: str):
    found = read(path)
    if isinstance(found, Envelope):
        return plots.envelope(found)
    if not isinstance(found, Study):
        return plots.landing(found)
    has_two_axes = all(", " in row["scenario"] for row in found.summary)
    return plots.curves(found) if has_two_axes else plots.table2(found)


def main() -> None:
    path, *name = sys.argv[1:] or [""]
    if not path or path.startswith("-") or len(name) > 1:
        sys.exit(__doc__)
    file = name[0] if name else os.path.splitext(os.path.normpath(path))[0] + ".svg"
    try:
        figure(path).savefig(file)
    except (AlightError, ImportError, OSError) as error:
        sys.exit(f"drawing {path}: {error}")
    print(f"written: {file}")


if __name__ == "__main__":
    main()
