"""Converts the messages of a topic to arrays, one column per field."""

from __future__ import annotations

import math
from typing import Any, Dict, Iterator, List, Tuple

from ._lazy import numpy as np

NAN = math.nan
# Column names of fields whose schema does not state the unit. Quaternions rotate body axes into the frame.
NAMES = {
    "pose.position": "position_m",
    "pose.orientation": "quaternion_wxyz",
    "translation": "position_m",
    "rotation": "quaternion_wxyz",
    "linear_velocity": "body_velocity_mps",
    "angular_velocity": "body_rate_radps",
}
# The message's own time equals the file's log time, to the nanosecond.
LEFT_OUT = {"timestamp"}


class Columns:
    """Columns of one topic, filled message by message."""

    def __init__(self):
        self.times: List[float] = []
        self.values: Dict[str, List[Any]] = {}

    def add(self, time_ns: int, message) -> None:
        """Adds a message with its log time, ns."""
        self.times.append(time_ns / 1e9)
        for name, value in fields(message):
            self.values.setdefault(name, []).append(value)

    def arrays(self) -> Dict[str, Any]:
        """Returns `time_s` and every column."""
        columns = {name: _array(values) for name, values in self.values.items()}
        return {"time_s": np.array(self.times, dtype=float), **columns}


def parts(topic: str, message) -> Iterator[Tuple[str, Any]]:
    """Series of a message: the message itself, or one series per frame for transforms."""
    if topic != "/tf":
        return iter([(topic, message)])
    return ((f"/tf/{transform.child_frame_id}", transform) for transform in message.transforms)


def _is_repeated(field) -> bool:
    # protobuf 7 has no `label`, versions before 6.31 no `is_repeated`.
    repeated = getattr(field, "is_repeated", None)
    return field.label == field.LABEL_REPEATED if repeated is None else repeated


def fields(message, prefix: str = "") -> Iterator[Tuple[str, Any]]:
    """Name and value of each field. A field without a value is NaN, or an empty text."""
    for field in message.DESCRIPTOR.fields:
        if field.name in LEFT_OUT:
            continue
        path = prefix + field.name
        name = NAMES.get(path, path)
        value = getattr(message, field.name)
        kind = field.message_type and field.message_type.name
        if _is_repeated(field):
            if kind == "Pose":
                yield "position_m", [_vector(pose.position) for pose in value]
                yield "quaternion_wxyz", [_quaternion(pose.orientation) for pose in value]
            elif not kind:
                yield name, tuple(value)
        elif kind == "Vector3":
            yield name, _vector(value) if message.HasField(field.name) else (NAN,) * 3
        elif kind == "Quaternion":
            yield name, _quaternion(value) if message.HasField(field.name) else (NAN,) * 4
        elif kind:
            yield from fields(value, path + ".")
        elif field.has_presence and not message.HasField(field.name):
            yield name, "" if isinstance(value, str) else NAN
        elif not isinstance(value, bytes):
            yield name, value


def _vector(v) -> Tuple[float, float, float]:
    return (v.x, v.y, v.z)


def _quaternion(q) -> Tuple[float, float, float, float]:
    return (q.w, q.x, q.y, q.z)


def _array(values: List[Any]):
    """Returns an array; lists of unequal length are padded with NaN."""
    first = next((v for v in values if not isinstance(v, (tuple, list)) or len(v)), None)
    if not isinstance(first, (tuple, list)):
        return np.array(values) if first is not None else np.empty((len(values), 0))
    longest = max(len(v) for v in values)
    wide = np.full((len(values), longest, *np.shape(first)[1:]), NAN)
    for row, value in zip(wide, values):
        if len(value):
            row[: len(value)] = value
    return wide
