"""Telemetry logs (tlog) and DataFlash logs by pymavlink."""

from __future__ import annotations

import collections
import math
from typing import Dict, List

from .._lazy import dfreader, mavutil
from .._lazy import numpy as np
from .._program import AlightError
from ._frame import ACCEL, GYRO, Converted, euler, rate_hz

MILLI_G = 9.80665e-3
# Component id of the autopilot.
AUTOPILOT = 1
# Minimum rate of inertial samples, Hz: slower ones do not carry the motion, which the attitudes then provide.
MIN_IMU_HZ = 20.0
# Step back beyond which a clock counts as restarted, s.
RESTART_S = 1.0
# Times above this count from 1970 and are not on the autopilot's clock, s.
MAX_BOOT_S = 1e8
MAX_MESSAGES = 10_000_000

# Messages of inertial samples, best first, with their units: m/s² and rad/s.
IMUS = (("HIGHRES_IMU", 1.0, 1.0), ("SCALED_IMU", MILLI_G, 1e-3), ("RAW_IMU", MILLI_G, 1e-3))
TLOG = ["ATTITUDE", "ATTITUDE_QUATERNION", "GPS_RAW_INT", *(name for name, _, _ in IMUS)]
DATAFLASH = ["ATT", "IMU", "GPS"]


def _messages(path: str, opened, kinds: List[str]):
    """Messages of these kinds in a log that `opened` opens, with the logger's time, s."""
    log = None
    try:
        log = opened(path)
        for _ in range(MAX_MESSAGES):
            message = log.recv_match(type=kinds)
            if message is None:
                return
            yield message, float(getattr(message, "_timestamp", math.nan))
    except (OSError, ImportError):
        raise
    except Exception as error:  # pymavlink raises whatever its parsing meets.
        raise AlightError(f"{path}: no log that pymavlink reads ({type(error).__name__}: {error})", 2) from None
    finally:
        # Old releases have no `close` for a DataFlash log.
        if hasattr(log, "close"):
            log.close()
    raise AlightError(f"{path}: more than {MAX_MESSAGES} messages; cut the log into parts", 2)


def _boot_s(message) -> float:
    """Time on the autopilot's clock, s; NaN if the message has none."""
    if hasattr(message, "time_boot_ms"):
        return message.time_boot_ms * 1e-3
    t = getattr(message, "time_usec", 0) * 1e-6
    return t if 0.0 < t < MAX_BOOT_S else math.nan


def read_tlog(path: str, system) -> Converted:
    """Reads a telemetry log of the vessel's autopilot."""
    converted = Converted("MAVLink telemetry log")
    by_system: Dict[int, List[tuple]] = collections.defaultdict(list)
    for message, arrival_s in _messages(path, mavutil.mavlogfile, TLOG):
        if message.get_srcComponent() == AUTOPILOT:
            by_system[message.get_srcSystem()].append((message, arrival_s))
    if not by_system:
        return converted
    own = system if system is not None else max(by_system, key=lambda k: _attitudes(by_system[k]))
    if own not in by_system:
        there = ", ".join(str(k) for k in sorted(by_system))
        raise AlightError(f"{path}: no system {own} is in the log; there are: {there}", 2)
    if len(by_system) > 1:
        there = ", ".join(str(k) for k in sorted(by_system) if k != own)
        converted.notes.append(f"system {own} is taken for the vessel, left out: {there} (--system N takes another)")
    rows = _one_run(converted, by_system[own])
    kinds = collections.defaultdict(lambda: ([], []))
    for message, t in rows:
        times, messages = kinds[message.get_type()]
        times.append(t)
        messages.append(message)
    _tlog_attitude(converted, kinds)
    times, fixes = kinds["GPS_RAW_INT"]
    _tlog_fixes(converted, np.array(times), fixes)
    return converted


def _attitudes(rows: List[tuple]) -> int:
    return sum(message.get_type().startswith("ATTITUDE") for message, _ in rows)


def _one_run(converted: Converted, rows: List[tuple]) -> List[tuple]:
    """Messages of the longest run of the autopilot's clock, with their times on that clock."""
    runs: List[List[tuple]] = [[]]
    last = -math.inf
    for message, arrival_s in rows:
        boot_s = _boot_s(message)
        if boot_s < last - RESTART_S:
            runs.append([])
            last = -math.inf
        # NaN times are ignored.
        last = max(last, boot_s) if boot_s == boot_s else last
        runs[-1].append((message, arrival_s, boot_s))
    longest = max(runs, key=len)
    if len(runs) > 1:
        converted.notes.append(f"the autopilot started {len(runs) - 1} times more: the longest of its runs is converted")
    offsets = [boot_s - arrival_s for _, arrival_s, boot_s in longest if boot_s == boot_s]
    offset = float(np.median(offsets)) if offsets else 0.0
    return [(message, boot_s if boot_s == boot_s else arrival_s + offset) for message, arrival_s, boot_s in longest]


def _tlog_attitude(converted: Converted, kinds) -> None:
    times, imu = [], []
    for name, accel, gyro in IMUS:
        times, imu = kinds[name]
        if rate_hz(times) >= MIN_IMU_HZ:
            columns = {column: [getattr(m, f"{axis}gyro") * gyro for m in imu] for column, axis in zip(GYRO, "xyz")}
            columns.update((column, [getattr(m, f"{axis}acc") * accel for m in imu]) for column, axis in zip(ACCEL, "xyz"))
            converted.add(times, **columns)
            break
        if imu:
            converted.notes.append(f"{name} at {rate_hz(times):.1f} Hz is left out: too slow for inertial samples")
            imu = []
    name = max(("ATTITUDE", "ATTITUDE_QUATERNION"), key=lambda kind: len(kinds[kind][0]))
    times, attitudes = kinds[name]
    if not attitudes:
        return
    if name == "ATTITUDE":
        roll, pitch, yaw = (np.array([getattr(m, axis) for m in attitudes]) for axis in ("roll", "pitch", "yaw"))
    else:
        roll, pitch, yaw = euler(*([getattr(m, f"q{k}") for m in attitudes] for k in (1, 2, 3, 4)))
    converted.add_attitude(times, roll, pitch, yaw)
    if not imu:
        rates = {column: [getattr(m, f"{axis}speed") for m in attitudes] for column, axis in zip(GYRO, ("roll", "pitch", "yaw"))}
        converted.add(times, **rates)


def _tlog_fixes(converted: Converted, t, fixes) -> None:
    fixed = np.array([m.fix_type >= 2 for m in fixes], dtype=bool)
    if not fixed.any():
        return
    fixes = [m for m, has in zip(fixes, fixed) if has]
    converted.notes.append("heights of the receiver are above mean sea level")
    moving = [m.vel != 0xFFFF and m.cog != 0xFFFF for m in fixes]
    speed = np.where(moving, [m.vel * 0.01 for m in fixes], np.nan)
    course = np.radians([m.cog * 0.01 for m in fixes])
    converted.add(
        t[fixed],
        latitude_deg=[m.lat * 1e-7 for m in fixes],
        longitude_deg=[m.lon * 1e-7 for m in fixes],
        altitude_m=[m.alt * 1e-3 if m.fix_type >= 3 else math.nan for m in fixes],
        north_mps=speed * np.cos(course),
        east_mps=speed * np.sin(course),
    )


def read_dataflash(path: str, _system) -> Converted:
    """Reads a DataFlash log: the first inertial sensor, the filter's attitude, the first receiver."""
    converted = Converted("DataFlash")
    rows: Dict[str, Dict[str, List[float]]] = {kind: collections.defaultdict(list) for kind in DATAFLASH}
    for message, _ in _messages(path, dfreader.DFReader_binary, DATAFLASH):
        values = message.to_dict()
        if values.get("I", 0) != 0:
            continue
        for name, value in values.items():
            if isinstance(value, (int, float)):
                rows[message.get_type()][name].append(float(value))
    att, imu, gps = ({name: np.array(v) for name, v in rows[kind].items()} for kind in DATAFLASH)
    if imu:
        columns = {column: imu[f"Gyr{axis}"] for column, axis in zip(GYRO, "XYZ")}
        columns.update((column, imu[f"Acc{axis}"]) for column, axis in zip(ACCEL, "XYZ"))
        converted.add(imu["TimeUS"] * 1e-6, **columns)
    if att:
        angles = (np.radians(att[name]) for name in ("Roll", "Pitch", "Yaw"))
        converted.add_attitude(att["TimeUS"] * 1e-6, *angles)
    if gps:
        fixed = gps["Status"] >= 2
        speed, course = gps["Spd"], np.radians(gps["GCrs"])
        columns = {
            "latitude_deg": gps["Lat"],
            "longitude_deg": gps["Lng"],
            "altitude_m": np.where(gps["Status"] >= 3, gps["Alt"], np.nan),
            "north_mps": speed * np.cos(course),
            "east_mps": speed * np.sin(course),
        }
        if "VZ" in gps:
            columns["down_mps"] = gps["VZ"]
        converted.notes.append("heights of the receiver are above mean sea level")
        converted.add(gps["TimeUS"][fixed] * 1e-6, **{name: values[fixed] for name, values in columns.items()})
    return converted
