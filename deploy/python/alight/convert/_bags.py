"""Bags of ROS 1 and 2 by rosbags: Imu, NavSatFix, velocities, orientations and odometry by REP 103 (ENU, bodies FLU)."""

from __future__ import annotations

import collections
import os
import pathlib
from typing import Dict, List

from .._lazy import numpy as np
from .._lazy import rosbags_highlevel, rosbags_typesys
from .._program import AlightError
from ._frame import ACCEL, GYRO, Converted, euler

# Kinds of messages by their types. One topic of each kind is used.
KINDS = {
    "sensor_msgs/msg/Imu": "imu",
    "sensor_msgs/msg/NavSatFix": "fix",
    "geometry_msgs/msg/TwistStamped": "velocity",
    "geometry_msgs/msg/TwistWithCovarianceStamped": "velocity",
    "geometry_msgs/msg/Vector3Stamped": "velocity",
    "geometry_msgs/msg/QuaternionStamped": "orientation",
    "nav_msgs/msg/Odometry": "odometry",
}
MAX_MESSAGES = 10_000_000
# FLU to FRD.
SIGNS = (1.0, -1.0, -1.0)


def read(path: str, _system) -> Converted:
    """Reads a bag: a file of ROS 1, or a directory of ROS 2 (or a file in it)."""
    bag = pathlib.Path(path)
    if bag.is_file() and bag.suffix in (".db3", ".mcap"):
        bag = bag.parent
        if not (bag / "metadata.yaml").exists():
            raise AlightError(
                f"{path}: no metadata.yaml lies in its folder; name the folder of the whole bag of ROS 2 (an MCAP of Alight itself is "
                "read by `alight estimate`)",
                2,
            )
    # Bags in SQLite do not contain the definitions of their messages.
    store = rosbags_typesys.get_typestore(rosbags_typesys.Stores.ROS2_HUMBLE)
    converted = Converted("bag of ROS")
    try:
        with rosbags_highlevel.AnyReader([bag], default_typestore=store) as reader:
            taken = _topics(converted, reader.connections)
            kinds = _messages(path, reader, taken)
    except (AlightError, OSError, ImportError):
        raise
    except Exception as error:  # rosbags raises whatever its parsing meets.
        raise AlightError(f"{path}: no bag that rosbags reads ({type(error).__name__}: {error})", 2) from None
    if kinds:
        converted.notes.append("axes are those of REP 103: the world east, north, up, bodies forward, left, up")
    _imu(converted, kinds)
    _orientations(converted, kinds)
    _fixes(converted, kinds["fix"])
    _velocities(converted, kinds)
    return converted


def _topics(converted: Converted, connections) -> List:
    """Connections of the topic with the most messages of each kind; for velocities, topics of wrench or wind are excluded."""
    by_kind: Dict[str, List] = collections.defaultdict(list)
    for connection in connections:
        kind = KINDS.get(connection.msgtype)
        vector = connection.msgtype.endswith("Vector3Stamped")
        if kind and not (vector and "vel" not in os.path.basename(connection.topic).lower()):
            by_kind[kind].append(connection)
    taken = []
    for kind, of in sorted(by_kind.items()):
        counts = collections.Counter()
        for connection in of:
            counts[connection.topic] += connection.msgcount
        topic = counts.most_common(1)[0][0]
        taken += [connection for connection in of if connection.topic == topic]
        others = sorted(set(counts) - {topic})
        converted.notes.append(f"{kind} is {topic}" + (f", left out: {', '.join(others)}" if others else ""))
    return taken


def _messages(path: str, reader, connections) -> Dict[str, List[tuple]]:
    """Messages by kind with their times, s since 1970: the header's time if it has one, otherwise the bag's."""
    kinds: Dict[str, List[tuple]] = collections.defaultdict(list)
    # Without connections a reader returns all messages.
    for k, (connection, stamp_ns, raw) in enumerate(reader.messages(connections=connections) if connections else ()):
        if k >= MAX_MESSAGES:
            raise AlightError(f"{path}: more than {MAX_MESSAGES} messages; cut the bag into parts", 2)
        message = reader.deserialize(raw, connection.msgtype)
        stamp = message.header.stamp
        own_s = stamp.sec + stamp.nanosec * 1e-9
        kinds[KINDS[connection.msgtype]].append((own_s if own_s > 0 else stamp_ns * 1e-9, message))
    return kinds


def _column(rows: List[tuple], get):
    return np.array([get(message) for _, message in rows], dtype=float)


def _times(rows: List[tuple]):
    return np.array([t for t, _ in rows])


def _frd(rows: List[tuple], names, get) -> dict:
    """Converts the columns of a vector from FLU to FRD."""
    return {
        name: sign * _column(rows, lambda message, axis=axis: getattr(get(message), axis))
        for name, sign, axis in zip(names, SIGNS, "xyz")
    }


def _imu(converted: Converted, kinds) -> None:
    rows = kinds["imu"]
    if not rows:
        return
    # A covariance that begins with -1 marks a quantity that was not measured (sensor_msgs/Imu).
    measured = [row for row in rows if row[1].linear_acceleration_covariance[0] != -1]
    if measured:
        columns = _frd(measured, GYRO, lambda message: message.angular_velocity)
        columns.update(_frd(measured, ACCEL, lambda message: message.linear_acceleration))
        converted.add(_times(measured), **columns)
    else:
        converted.add(_times(rows), **_frd(rows, GYRO, lambda message: message.angular_velocity))


def _orientations(converted: Converted, kinds) -> None:
    """Attitudes of the first kind that has any."""
    candidates = (
        ([row for row in kinds["imu"] if row[1].orientation_covariance[0] != -1], lambda message: message.orientation),
        (kinds["orientation"], lambda message: message.quaternion),
        (kinds["odometry"], lambda message: message.pose.pose.orientation),
    )
    for rows, get in candidates:
        parts = [_column(rows, lambda message, axis=axis: getattr(get(message), axis)) for axis in "wxyz"]
        # A zero quaternion marks an attitude that was not measured.
        known = np.sum(np.square(parts), axis=0) > 0.25
        if known.any():
            roll, pitch, yaw = euler(*(part[known] for part in parts))
            converted.add_attitude(_times(rows)[known], roll, -pitch, 0.5 * np.pi - yaw)
            return


def _fixes(converted: Converted, rows: List[tuple]) -> None:
    rows = [row for row in rows if row[1].status.status >= 0]
    if rows:
        names = {"latitude_deg": "latitude", "longitude_deg": "longitude", "altitude_m": "altitude"}
        columns = {column: _column(rows, lambda m, name=name: getattr(m, name)) for column, name in names.items()}
        converted.add(_times(rows), **columns)


def _vector(message):
    """Velocity of a message with a twist, or of a vector."""
    if hasattr(message, "vector"):
        return message.vector
    twist = message.twist
    return getattr(twist, "twist", twist).linear


def _velocities(converted: Converted, kinds) -> None:
    rows = kinds["velocity"]
    if rows:
        east, north, up = (_column(rows, lambda m, axis=axis: getattr(_vector(m), axis)) for axis in "xyz")
        converted.add(_times(rows), north_mps=north, east_mps=east, down_mps=-up)
        return
    rows = kinds["odometry"]
    if not rows:
        return
    # The velocity of an odometry message is in body axes.
    w, x, y, z = (_column(rows, lambda m, axis=axis: getattr(m.pose.pose.orientation, axis)) for axis in "wxyz")
    body = np.stack([_column(rows, lambda m, axis=axis: getattr(m.twist.twist.linear, axis)) for axis in "xyz"])
    axis = np.stack([x, y, z])
    cross = np.cross(axis, body, axis=0)
    east, north, up = body + 2.0 * (w * cross + np.cross(axis, cross, axis=0))
    converted.add(_times(rows), north_mps=north, east_mps=east, down_mps=-up)
