"""Shared parts of the tests: the module under test, and landings that are flown once.

    ALIGHT=target/release/alight python3 -m unittest discover deploy/python/tests

flies about fifteen landings, a minute on two cores. With ALIGHT_TEST_INSTALLED=1 the installed wheel is tested, without ALIGHT with
the wheel's own program; with ALIGHT_TEST_FLIGHT=DIR a recorded flight is read as well (`alight land --log DIR`).
"""

import atexit
import functools
import json
import os
import pathlib
import subprocess
import sys
import tempfile

# An installed wheel is tested as it is; in a checkout the module is next to the tests.
if not os.environ.get("ALIGHT_TEST_INSTALLED"):
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import alight

# Some tests run in another directory, where a relative path would not be found.
if os.environ.get("ALIGHT"):
    os.environ["ALIGHT"] = alight.program()

_kept = tempfile.TemporaryDirectory(prefix="alight-tests-")
atexit.register(_kept.cleanup)
FILES = pathlib.Path(_kept.name)


@functools.lru_cache(maxsize=None)
def landing():
    """One successful landing with its recording: (run, path)."""
    path = FILES / "landing.mcap"
    return alight.trial(seed=1, sea="rough", record=path), path


def printed(*words):
    """The JSON of the program's last line, requested without the module."""
    done = subprocess.run([alight.program(), *words, "--json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    return json.loads(done.stdout.splitlines()[-1])


def stand_in(directory, text):
    """Path of a shell script that replaces the program."""
    path = pathlib.Path(directory) / "alight"
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)
    return str(path)
