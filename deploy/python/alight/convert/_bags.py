"""Bags of ROS 1 and 2 by rosbags: Imu, NavSatFix, velocities, orientations and odometry by REP 103 (ENU, bodies FLU)."""

from __future__ import annotations

import collections
import os
import pathlib
import re
from typing import Dict, List, Optional, Sequence

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
# Words of a topic that is no measurement, and of a topic or frame whose axes are not those of world or hull.
COMMANDS = re.compile(r"(?:^|[/_])(?:cmd|command|commanded|setpoint|target|desired|reference|goal)(?:$|[/_])")
BODIES = re.compile(r"(?:^|[/_])(?:body|base_link|base_footprint|fcu)(?:$|[/_])")
CAMERAS = re.compile(r"optical|(?:^|[/_])camera(?:$|[/_\d])")
# Standard deviation above which a position is not measured, m: receivers state 1e6 m without an accuracy.
MAX_SD_M = 100.0
# Correlation of a yaw with the integral of the gyroscope from which that decides its sign, over this time, s.
MIN_CORRELATION, TURN_S = 0.5, 1.0
# Speed from which a course over ground decides the axes of a heading, m/s, and the largest median angle between the two, deg.
COURSE_MPS, COURSE_DEG = 1.0, 45.0
# FLU to FRD.
SIGNS = (1.0, -1.0, -1.0)


def read(path: str, _system, topics: Sequence[str] = (), axes: Optional[str] = None) -> Converted:
    """Reads a bag: a file of ROS 1, or a directory of ROS 2 (or a file in it).

    `topics` are used for their kinds. `axes` are those of headings: enu (REP 103) or compass (clockwise from north); by default
    gyroscope and course over ground decide.
    """
    bag = pathlib.Path(path)
    converted = Converted("bag of ROS")
    if bag.is_file() and bag.suffix in (".db3", ".mcap"):
        if (bag.parent / "metadata.yaml").exists():
            bag = bag.parent
        elif bag.suffix == ".mcap":
            converted.notes.append("metadata.yaml is missing: read without it")
        else:
            raise AlightError(f"{path}: no metadata.yaml lies in its folder; name the folder of the whole bag of ROS 2", 2)
    # Bags in SQLite do not contain the definitions of their messages.
    store = rosbags_typesys.get_typestore(rosbags_typesys.Stores.ROS2_HUMBLE)
    try:
        with rosbags_highlevel.AnyReader([bag], default_typestore=store) as reader:
            taken = _topics(path, converted, reader, topics)
            kinds = _messages(path, reader, taken)
    except (AlightError, OSError, ImportError):
        raise
    except Exception as error:  # rosbags raises whatever its parsing meets.
        raise AlightError(f"{path}: no bag that rosbags reads ({type(error).__name__}: {error})", 2) from None
    if kinds:
        converted.notes.append("axes are those of REP 103: the world east, north, up, bodies forward, left, up")
    _imu(converted, kinds)
    course = _velocities(converted, kinds)
    _orientations(converted, kinds, course, axes)
    _fixes(converted, kinds["fix"])
    return converted


def _topics(path: str, converted: Converted, reader, named: Sequence[str]) -> List:
    """Connections of the best topic of each kind, by [`_fault`] and then by the number of messages."""
    by_kind: Dict[str, List] = collections.defaultdict(list)
    for connection in reader.connections:
        kind = KINDS.get(connection.msgtype)
        vector = connection.msgtype.endswith("Vector3Stamped")
        # Vectors without a velocity are those of a wrench or of the wind.
        if kind and not (vector and "vel" not in os.path.basename(connection.topic).lower()):
            by_kind[kind].append(connection)
    unknown = set(named) - {connection.topic for of in by_kind.values() for connection in of}
    if unknown:
        there = ", ".join(sorted(connection.topic for of in by_kind.values() for connection in of))
        raise AlightError(f"{path}: no topic {', '.join(sorted(unknown))} that is read; there are: {there or 'none'}", 2)
    taken = []
    for kind, of in sorted(by_kind.items()):
        counts = collections.Counter()
        for connection in of:
            counts[connection.topic] += connection.msgcount
        faults = {topic: _fault(kind, reader, [c for c in of if c.topic == topic]) for topic in counts}
        topic = max(sorted(counts), key=lambda topic: (topic in named, not faults[topic], counts[topic]))
        others = [
            f"{other} ({faults[other] or f'{counts[other]} messages, {counts[topic]} of the other'})" for other in sorted(set(counts) - {topic})
        ]
        # A command or a velocity in other axes is worse than none.
        if faults[topic] and kind == "velocity" and topic not in named:
            others.append(f"{topic} ({faults[topic]})")
            converted.notes.append(f"no {kind} is used, left out: {', '.join(others)} (--topic NAME takes one)")
            continue
        taken += [connection for connection in of if connection.topic == topic]
        converted.notes.append(f"{kind} is {topic}" + (f", left out: {', '.join(others)} (--topic NAME takes another)" if others else ""))
    return taken


def _fault(kind: str, reader, connections) -> str:
    """Why a topic is no measurement of the vessel, by its name and its first message; empty if nothing shows it."""
    topic = connections[0].topic.lower()
    if COMMANDS.search(topic):
        return "a command"
    first = next(iter(reader.messages(connections=connections)), None)
    if first is None:
        return "empty"
    message = reader.deserialize(first[2], first[0].msgtype)
    frame = message.header.frame_id.lower()
    if CAMERAS.search(topic) or CAMERAS.search(frame):
        return "of a camera"
    if kind == "velocity" and (BODIES.search(topic) or BODIES.search(frame)):
        return f"in body axes, frame `{message.header.frame_id}`"
    if kind == "imu" and (message.orientation_covariance[0] == -1 or not _known(message.orientation)):
        return "without an attitude"
    return ""


def _known(q) -> bool:
    return q.w**2 + q.x**2 + q.y**2 + q.z**2 > 0.25


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


def _orientations(converted: Converted, kinds, course, axes: Optional[str]) -> None:
    """Attitudes of the first kind that has any; one without roll and pitch is a heading."""
    candidates = (
        ("imu", [row for row in kinds["imu"] if row[1].orientation_covariance[0] != -1], lambda message: message.orientation),
        ("orientation", kinds["orientation"], lambda message: message.quaternion),
        ("odometry", kinds["odometry"], lambda message: message.pose.pose.orientation),
    )
    has_tilt = has_heading = False
    for kind, rows, get in candidates:
        parts = [_column(rows, lambda message, axis=axis: getattr(get(message), axis)) for axis in "wxyz"]
        # A zero quaternion marks an attitude that was not measured.
        known = np.sum(np.square(parts), axis=0) > 0.25
        if not known.any():
            continue
        w, x, y, z = (part[known] for part in parts)
        roll, pitch, yaw = euler(w, x, y, z)
        t = _times(rows)[known]
        flat = bool(np.all(x == 0.0) and np.all(y == 0.0))
        if flat and np.all(z == z[0]) and len(t) > 1:
            converted.notes.append(f"the orientation of {kind} is the same in all messages: not measured")
            continue
        heading = _heading(converted, kinds, kind, t, yaw, course, axes, flat)
        if flat:
            converted.notes.append(f"roll and pitch of {kind} are 0.0 in all messages: not measured, it is a heading")
            if not has_heading:
                converted.add_heading(t, heading)
        elif not has_tilt:
            converted.add_attitude(t, roll, -pitch, None if has_heading else heading)
            has_tilt = True
        has_heading = True
        if has_tilt:
            return


def _heading(converted: Converted, kinds, kind: str, t, yaw, course, axes: Optional[str], flat: bool):
    """Heading clockwise from north (rad) of a yaw by REP 103, or of a yaw that a driver has taken from its compass."""
    enu = 0.5 * np.pi - yaw
    if axes is not None:
        return yaw if axes == "compass" else enu
    turns = _correlation(t, yaw, kinds["imu"])
    off = [_off_course(t, heading, course) for heading in (enu, yaw)] if course is not None else [None, None]
    by_course = None not in off and off[1] < COURSE_DEG < off[0]
    if turns < -MIN_CORRELATION or (turns < MIN_CORRELATION and by_course):
        why = "its change has the gyroscope's sign only so"
        if turns >= -MIN_CORRELATION:
            why = f"by REP 103 it differs from the course over ground by {off[0]:.0f} deg, so by {off[1]:.0f} deg"
        converted.notes.append(f"the yaw of {kind} is taken as a compass heading, clockwise from north: {why} (--axes enu takes the other)")
        return yaw
    if flat and turns < MIN_CORRELATION and (None in off or off[0] > COURSE_DEG):
        converted.notes.append(
            f"the yaw of {kind} is taken as anticlockwise from east (REP 103), and neither gyroscope nor course over ground confirms it; "
            "for a compass heading (nmea_navsat_driver) give --axes compass"
        )
    return enu


def _correlation(t, yaw, rows: List[tuple]) -> float:
    """Correlation of the change of a yaw (rad) with the integral of the gyroscope about the same axis, upward; 0 without one."""
    if len(rows) < 2 or len(t) < 2:
        return 0.0
    at, rate = _times(rows), _column(rows, lambda m: m.angular_velocity.z)
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.clip(np.diff(at), 0.0, 1.0))))
    grid = np.arange(max(t[0], at[0]), min(t[-1], at[-1]), TURN_S)
    if len(grid) < 20:
        return 0.0
    a, b = (np.diff(np.interp(grid, times, values)) for times, values in ((t, np.unwrap(yaw)), (at, turned)))
    size = np.std(a) * np.std(b)
    return float(np.mean((a - a.mean()) * (b - b.mean())) / size) if size > 0.0 else 0.0


def _off_course(t, heading, course) -> Optional[float]:
    """Median angle between headings (rad) and the course over ground while the boat moves, deg; None at rest."""
    at, north, east = course
    moves = np.hypot(north, east) >= COURSE_MPS
    if moves.sum() < 10:
        return None
    at, angle = at[moves], np.arctan2(east[moves], north[moves])
    off = angle[np.clip(np.searchsorted(at, t), 0, len(at) - 1)] - heading
    return float(np.degrees(np.median(np.abs(np.arctan2(np.sin(off), np.cos(off))))))


def _fixes(converted: Converted, rows: List[tuple]) -> None:
    rows = [row for row in rows if row[1].status.status >= 0]
    if not rows:
        return
    # Variances east, north and up, if the type of the covariance is not 0 (unknown).
    stated = _column(rows, lambda m: m.position_covariance_type) > 0
    across, up = (np.where(stated, _column(rows, lambda m, k=k: m.position_covariance[k]), 0.0) for k in (0, 8))
    keep = across <= MAX_SD_M**2
    if not keep.all():
        converted.notes.append(f"{int((~keep).sum())} positions whose covariance states more than {MAX_SD_M:.0f} m are left out")
    names = {"latitude_deg": "latitude", "longitude_deg": "longitude", "altitude_m": "altitude"}
    columns = {column: _column(rows, lambda m, name=name: getattr(m, name))[keep] for column, name in names.items()}
    altitude = np.where(up[keep] <= MAX_SD_M**2, columns["altitude_m"], np.nan)
    columns["altitude_m"] = _measured(converted, "the altitude", altitude)
    converted.add(_times(rows)[keep], **columns)


def _measured(converted: Converted, what: str, values):
    """NaN in place of values that are bit by bit 0 in all messages."""
    if len(values) > 1 and np.all(values == 0.0):
        converted.notes.append(f"{what} is 0.0 in all messages: not measured")
        return np.full(len(values), np.nan)
    return values


def _vector(message):
    """Velocity of a message with a twist, or of a vector."""
    if hasattr(message, "vector"):
        return message.vector
    twist = message.twist
    return getattr(twist, "twist", twist).linear


def _velocities(converted: Converted, kinds):
    """Adds the velocities; returns their times, north and east, or None."""
    rows = kinds["velocity"]
    if rows:
        east, north, up = (_column(rows, lambda m, axis=axis: getattr(_vector(m), axis)) for axis in "xyz")
        up = _measured(converted, "the vertical speed", up)
    else:
        rows = kinds["odometry"]
        if not rows:
            return None
        # The velocity of an odometry message is in body axes.
        w, x, y, z = (_column(rows, lambda m, axis=axis: getattr(m.pose.pose.orientation, axis)) for axis in "wxyz")
        body = np.stack([_column(rows, lambda m, axis=axis: getattr(m.twist.twist.linear, axis)) for axis in "xyz"])
        axis = np.stack([x, y, z])
        cross = np.cross(axis, body, axis=0)
        east, north, up = body + 2.0 * (w * cross + np.cross(axis, cross, axis=0))
    converted.add(_times(rows), north_mps=north, east_mps=east, down_mps=-up)
    return _times(rows), north, east
