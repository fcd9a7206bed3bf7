"""The program: its location, its command line, its output."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from typing import Any, List, Optional, Sequence

# Maximum number of bytes kept of the program's messages when it fails, from the end.
MAX_MESSAGE = 16_384
# Maximum size of the output that is read, bytes; the JSON of a study of 10 000 rows has 20 MB.
MAX_ANSWER = 256 << 20


class AlightError(Exception):
    """Error of the program or of this package, with its message.

    `code` is the program's exit code: 1 a failed landing, 2 bad input, 3 a computer that was too slow, below 0 the
    signal that ended it; None if no program ended (not found, timed out, a file that cannot be read).
    """

    def __init__(self, message: str, code: Optional[int] = None):
        super().__init__(message)
        self.code = code


def program() -> str:
    """Returns the path of the program `alight`.

    The environment variable ALIGHT names it; otherwise it is searched for next to the running Python's scripts, where the
    wheel installs it, and then on PATH.
    """
    named = os.environ.get("ALIGHT")
    if named:
        # As in a shell, a name without a directory is searched for on PATH.
        found = shutil.which(named)
        if found:
            return os.path.abspath(found)
        raise AlightError(
            f"ALIGHT={named}: no program that can be run is there; name the built program, or remove the variable"
        )
    beside = _scripts()
    for directory in beside:
        found = shutil.which("alight", path=directory)
        if found:
            return found
    found = shutil.which("alight")
    if found:
        return found
    raise AlightError(
        f"the program alight is neither in {' nor in '.join(beside)} nor on PATH; install its wheel into this Python, or "
        "name the built program by the environment variable ALIGHT"
    )


def _scripts() -> List[str]:
    """Directories in which an installation of this Python places programs."""
    found = [sysconfig.get_path("scripts"), os.path.dirname(sys.executable)]
    # `pip install --user`.
    user = "nt_user" if os.name == "nt" else "posix_user"
    if user in sysconfig.get_scheme_names():
        found.append(sysconfig.get_path("scripts", user))
    return list(dict.fromkeys(directory for directory in found if directory))


def arguments(flags: dict) -> List[str]:
    """Flags of the command line: `motion_scale=2` becomes `--motion-scale=2`, True a bare flag, a list `--winds=4,6`; None and
    False are omitted."""
    written = []
    for name, value in flags.items():
        flag = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            written.append(flag)
        elif isinstance(value, str) or not hasattr(value, "__iter__"):
            # With `=` a value that begins with a hyphen is not parsed as a flag.
            written.append(f"{flag}={value}")
        else:
            written.append(f"{flag}={','.join(str(part) for part in value)}")
    return written


@dataclasses.dataclass
class Answer:
    """Result of a command: exit code, the JSON of its last line, the end of its messages."""

    code: int
    value: Any
    message: str


def run(words: Sequence[Any], flags: dict, timeout_s: float, codes: Sequence[int] = (0, 1)) -> Answer:
    """Runs `alight WORDS FLAGS --json` for at most `timeout_s`.

    A result with exit code 1 is returned, because a failed landing also has an outcome; `codes` lists the accepted codes.
    """
    command = [program(), *(str(word) for word in words), *arguments(flags), "--json"]
    shown = " ".join(["alight", *command[1:]])
    # Files instead of pipes, so that the output of a long study is not kept in memory.
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, timeout=timeout_s)
        except subprocess.TimeoutExpired:
            raise AlightError(
                f"{shown}: not ended after {timeout_s:g} s, and stopped; give more by timeout_s"
            ) from None
        except OSError as error:
            raise AlightError(f"{shown}: {command[0]} cannot be run: {error}") from None
        message = _end(err, MAX_MESSAGE).strip()
        lines = _end(out, MAX_ANSWER).splitlines()
    try:
        value = json.loads(lines[-1]) if lines else None
    except ValueError:
        value = None
    if value is None or done.returncode not in codes:
        raise AlightError(message or f"{shown}: ended with exit code {done.returncode}, without a word", done.returncode)
    return Answer(done.returncode, value, message)


def _end(file, most: int) -> str:
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - most))
    return file.read().decode("utf-8", "replace")
