"""Flies one landing, and reads recordings."""

from __future__ import annotations

import inspect
import json
import os
import tempfile
from typing import Any, Dict, Iterable, Optional

from . import _program
from ._door import served
from ._columns import Columns, parts
from ._folders import Envelope, Study
from ._lazy import mcap_decoder, mcap_reader
from ._program import AlightError
from ._run import Run

# Shapes and points are for viewers, and are read only if requested by name.
FOR_VIEWERS = ("/scene", "/points/")
# Maximum size of flight.json, bytes: the program writes no larger file.
MAX_SUMMARY = 1 << 20


def trial(*, topics: Optional[Iterable[str]] = None, timeout_s: float = 600.0, **flags: Any) -> Run:
    """Flies one landing in the simulated world: `alight trial`.

    Flags are those of `alight trial --help` with `_` for `-`: `trial(seed=1, sea="rough", wind=5, keep_mean=True)`.
    A failed landing is a result (`outcome["success"]`); input that the program rejects raises an AlightError with its message.
    `record="landing.mcap"` keeps the recording, 9 MB; otherwise it is removed. `topics` are the topics to read (by default all
    except those that only viewers draw), `timeout_s` is the maximum computing time, s.

    `planner` and `predictor` may be functions that receive an input (`alight config schema planner-input`) as a dict and return
    an answer without its version, or None: `trial(planner=lambda line: {"common": True})`. What they raise is raised after the
    flight.
    """
    with tempfile.TemporaryDirectory(prefix="alight-") as directory, served(flags) as names:
        kept = flags.pop("record", None)
        path = str(kept or os.path.join(directory, "trial.mcap"))
        answer = _program.run(["trial"], {**flags, "record": path}, timeout_s)
        run = read_recording(path, topics=topics)
    run.outcome = {**answer.value, **names}
    run.path = path if kept else None
    return run


def read(
    path,
    *,
    topics: Optional[Iterable[str]] = None,
    start_s: Optional[float] = None,
    end_s: Optional[float] = None,
    max_messages: int = 2_000_000,
    timeout_s: float = 600.0,
):
    """Reads files that the program wrote.

    A recording (`.mcap`) or a directory of the flight recorder returns a `Run`; the directory of a study
    (`summary.json`) a `Study`, that of an envelope (`envelope.json`) an `Envelope`. The program replays a flight
    (`alight replay --record`), because its files contain the inputs of the processes, not their outputs; a flight of a real
    vehicle has no `/truth` and no positions of the bodies in `/tf`.

    `topics`, `start_s` and `end_s` (in the unit of `time_s`) select a part; more than `max_messages` are rejected, so that an
    hour's flight does not fill the memory by accident. `timeout_s` is the maximum duration of `replay`, s.
    """
    path = os.fspath(path)
    part = {"topics": topics, "start_s": start_s, "end_s": end_s, "max_messages": max_messages}
    if not os.path.isdir(path):
        return read_recording(path, **part)
    for name, kind in (("envelope.json", Envelope), ("summary.json", Study)):
        if os.path.exists(os.path.join(path, name)):
            return kind.read(path)
    if not any(name.endswith(".mcap") for name in os.listdir(path)):
        raise AlightError(
            f"{path} is neither a flight (PROCESS-BOOT-NUMBER.mcap) nor the --out of a study or an envelope"
        )
    with tempfile.TemporaryDirectory(prefix="alight-") as directory:
        joined = os.path.join(directory, "flight.mcap")
        # Exit code 1 means that an output differs. It is reported, not raised, because the recorded data are complete.
        answer = _program.run(["replay", path], {"record": joined}, timeout_s)
        run = read_recording(joined, **part)
    run.path = path
    run.outcome["replay"] = answer.value.get("verdict", "")
    run.flight = _summary(path)
    if run.flight is not None:
        run.outcome.update({k: run.flight[k] for k in ("outcome", "reason") if k in run.flight})
    return run


def _summary(directory: str) -> Optional[Dict[str, Any]]:
    """Reads `flight.json`, which a service or `alight land --log` writes; None if it is missing."""
    try:
        with open(os.path.join(directory, "flight.json"), encoding="utf-8") as file:
            return json.loads(file.read(MAX_SUMMARY))
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise AlightError(f"reading {directory}/flight.json: {error}") from None


def read_recording(
    path: str,
    *,
    topics: Optional[Iterable[str]] = None,
    start_s: Optional[float] = None,
    end_s: Optional[float] = None,
    max_messages: int = 2_000_000,
) -> Run:
    """Reads the topics of an MCAP file that have a schema; `/node/*` are the program's own topics and are omitted."""
    try:
        with open(path, "rb") as file:
            reader = mcap_reader.make_reader(file, decoder_factories=[mcap_decoder.DecoderFactory()])
            return _read(reader, path, topics, start_s, end_s, max_messages)
    except (AlightError, ImportError):
        raise
    except OSError as error:
        raise AlightError(f"reading {path}: {error.strerror or error}") from None
    except Exception as error:
        # A damaged file fails in any layer of the reader: framing, compression, protobuf, text.
        raise AlightError(
            f"reading {path}: {str(error) or type(error).__name__}; is it a whole recording (.mcap)? One that a kill cut "
            "off gets its end by alight flights --mend"
        ) from error


def _read(reader, path, topics, start_s, end_s, max_messages) -> Run:
    summary = reader.get_summary()
    if summary is None:
        raise AlightError(f"reading {path}: it has no index; alight flights --mend gives it one")
    there = sorted(
        channel.topic
        for channel in summary.channels.values()
        if channel.message_encoding == "protobuf" and channel.schema_id in summary.schemas
    )
    if not there:
        raise AlightError(
            f"{path} has no topic that can be read; a file of one process of a flight holds its inputs alone: read the "
            "flight's directory"
        )
    if topics is None:
        wanted = [topic for topic in there if not topic.startswith(FOR_VIEWERS)]
    else:
        wanted = [topics] if isinstance(topics, str) else list(topics)
        unknown = [topic for topic in wanted if topic not in there]
        if unknown:
            raise AlightError(f"no {', '.join(unknown)} in {path}; there are: {', '.join(there)}")
    found: Dict[str, Columns] = {}
    messages = reader.iter_decoded_messages(topics=wanted, **_span(reader, start_s, end_s)) if wanted else ()
    for count, (_, channel, message, decoded) in enumerate(messages):
        if count >= max_messages:
            raise AlightError(
                f"{path} has more than {max_messages} messages; read a part by topics, start_s and end_s, or raise "
                "max_messages"
            )
        for name, part in parts(channel.topic, decoded):
            found.setdefault(name, Columns()).add(message.log_time, part)
    outcome: Dict[str, Any] = {}
    for record in reader.iter_metadata():
        if record.name in ("recording", "outcome"):
            outcome.update(record.metadata)
    if "seed" in outcome:
        outcome["seed"] = int(outcome["seed"])
    files = {a.name: a.data.decode("utf-8", "replace") for a in reader.iter_attachments()}
    return Run(outcome, {name: columns.arrays() for name, columns in found.items()}, files, path=path)


def _span(reader, start_s: Optional[float], end_s: Optional[float]) -> Dict[str, int]:
    """Arguments for the span from `start_s` to before `end_s`: newer readers renamed both and warn of the old names."""
    newer = "starting_at" in inspect.signature(reader.iter_decoded_messages).parameters
    names = ("starting_at", "ending_before") if newer else ("start_time", "end_time")
    return {name: round(time_s * 1e9) for name, time_s in zip(names, (start_s, end_s)) if time_s is not None}
