"""Planners and predictors that are functions of this Python."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import tempfile
import threading
from typing import Any, Callable, Dict, Iterator

VERSION = 1


class Served:
    """A function that answers the lines of one flight, through two named pipes."""

    def __init__(self, function: Callable[[Dict[str, Any]], Any], directory: str, part: str):
        self.function = function
        self.questions, self.answers = (os.path.join(directory, f"{part}-{name}") for name in ("questions", "answers"))
        for path in (self.questions, self.answers):
            os.mkfifo(path)
        self.error: Exception | None = None
        self.thread = threading.Thread(target=self._answer, daemon=True)
        self.thread.start()

    @property
    def name(self) -> str:
        """Name of the function."""
        return getattr(self.function, "__name__", type(self.function).__name__)

    @property
    def command(self) -> str:
        """Program that carries the lines."""
        return f"exec:cat {shlex.quote(self.answers)} & exec cat > {shlex.quote(self.questions)}"

    def _answer(self) -> None:
        with contextlib.suppress(BrokenPipeError), open(self.questions, encoding="utf-8") as lines:
            with open(self.answers, "w", encoding="utf-8") as answers:
                for line in lines:
                    answers.write(json.dumps({"version": VERSION, **self._one(json.loads(line))}) + "\n")
                    answers.flush()

    def _one(self, line: Dict[str, Any]) -> Dict[str, Any]:
        if self.error is None:
            try:
                answer = self.function(line)
                json.dumps(answer)
                return {"none": "no answer"} if answer is None else answer
            except Exception as error:  # The caller gets it after the flight.
                self.error = error
        return {"none": f"{self.name}: {self.error!r}"[:200]}

    def end(self) -> None:
        """Ends the thread, also where no program has opened the pipes."""
        for path in (self.questions, self.answers):
            with contextlib.suppress(OSError):
                os.close(os.open(path, os.O_RDWR | os.O_NONBLOCK))
        self.thread.join(1.0)


@contextlib.contextmanager
def served(flags: Dict[str, Any]) -> Iterator[Dict[str, str]]:
    """Replaces functions among the flags `planner` and `predictor` by commands; yields their names. An exception in a
    function is raised at the end."""
    with tempfile.TemporaryDirectory(prefix="alight-") as directory:
        parts = {name: Served(flags[name], directory, name) for name in ("planner", "predictor") if callable(flags.get(name))}
        flags.update({name: part.command for name, part in parts.items()})
        try:
            yield {name: part.name for name, part in parts.items()}
        finally:
            for part in parts.values():
                part.end()
        for part in parts.values():
            if part.error is not None:
                raise part.error
