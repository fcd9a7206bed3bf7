"""Flies simulated landings with the program `alight`, and reads its recordings and live data.

    import alight

    run = alight.trial(seed=1, sea="rough")     # one landing: its outcome, and every recorded series
    run.outcome["position_error_m"]
    alight.plots.landing(run).savefig("landing.svg")

`python -m alight.convert FILE` converts recordings of other programs to the CSV that `alight estimate` reads.

The program computes everything; this package calls it and reads its output. The program is the one that the environment
variable ALIGHT names, otherwise the one next to this Python's scripts, otherwise the one on PATH.

Units are SI and part of the names (`_m`, `_mps`, `_deg`, `_s`). Axes: NED is north, east, down; the axes of a body or deck are
forward, starboard, down.
"""

from . import convert, plots
from ._folders import Envelope, Study, Trials, envelope, study, trials
from ._live import live
from ._program import AlightError, program
from ._reading import read, trial
from ._relative import relative
from ._run import Run

__all__ = [
    "AlightError",
    "Envelope",
    "Run",
    "Study",
    "Trials",
    "convert",
    "envelope",
    "live",
    "plots",
    "program",
    "read",
    "relative",
    "study",
    "trial",
    "trials",
]
