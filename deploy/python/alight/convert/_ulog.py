"""ULog of PX4 by pyulog: `sensor_combined`, `vehicle_attitude` and `sensor_gps` (`vehicle_gps_position` in old ones)."""

from __future__ import annotations

from .._lazy import numpy as np
from .._lazy import pyulog
from .._program import AlightError
from ._frame import ACCEL, GYRO, Converted, euler

TOPICS = ["sensor_combined", "vehicle_attitude", "sensor_gps", "vehicle_gps_position"]
# Names of fields with their units in those of the columns: since 2023, and before.
LATITUDE = (("latitude_deg", 1.0), ("lat", 1e-7))
LONGITUDE = (("longitude_deg", 1.0), ("lon", 1e-7))
ELLIPSOID = (("altitude_ellipsoid_m", 1.0), ("alt_ellipsoid", 1e-3))
SEA_LEVEL = (("altitude_msl_m", 1.0), ("alt", 1e-3))


def read(path: str, _system) -> Converted:
    """Reads a log."""
    try:
        log = pyulog.ULog(path, TOPICS, disable_str_exceptions=True)
    except OSError:
        raise
    except Exception as error:  # pyulog raises whatever its parsing meets.
        raise AlightError(f"{path}: no ULog that pyulog reads ({type(error).__name__}: {error})", 2) from None
    converted = Converted("ULog")
    if log.file_corruption:
        converted.notes.append("the log is damaged, and read as far as pyulog goes")
    if log.dropouts:
        converted.notes.append(f"the autopilot dropped data {len(log.dropouts)} times while logging")
    first = {}
    for data in log.data_list:
        if data.name in first:
            converted.notes.append(f"{data.name} {data.multi_id} is left out, {first[data.name].multi_id} is taken")
        else:
            first[data.name] = data
    fields = {name: data.data for name, data in first.items()}
    _imu(converted, fields.get("sensor_combined"))
    fixes = fields.get("sensor_gps", fields.get("vehicle_gps_position"))
    has_heading = _fixes(converted, fixes)
    _attitude(converted, fields.get("vehicle_attitude"), has_heading)
    return converted


def _time(data):
    """Time of sampling, s of the autopilot's clock; without it, time of publication."""
    published = data["timestamp"]
    sampled = data.get("timestamp_sample", published)
    return np.where(sampled > 0, sampled, published) * 1e-6


def _imu(converted: Converted, data) -> None:
    if data is None:
        return
    columns = {name: data[f"gyro_rad[{k}]"] for k, name in enumerate(GYRO)}
    columns.update((name, data[f"accelerometer_m_s2[{k}]"]) for k, name in enumerate(ACCEL))
    converted.add(_time(data), **columns)


def _attitude(converted: Converted, data, has_heading: bool) -> None:
    if data is None:
        return
    roll, pitch, yaw = euler(*(data[f"q[{k}]"] for k in range(4)))
    converted.add_attitude(_time(data), roll, pitch, None if has_heading else yaw)


def _first(data, *names):
    """First existing one of these fields, in the column's unit; the KeyError names the last."""
    for name, unit in names:
        if name in data:
            return np.asarray(data[name], dtype=float) * unit
    raise KeyError(names[-1][0])


def _fixes(converted: Converted, data) -> bool:
    """Adds fixes; returns whether the receiver measures the heading."""
    if data is None:
        return False
    t = _time(data)
    fixed = data["fix_type"] >= 2
    height = _first(data, *ELLIPSOID, *SEA_LEVEL)
    if not any(name in data for name, _ in ELLIPSOID):
        converted.notes.append("no height above the ellipsoid: that above mean sea level is taken")
    columns = {"latitude_deg": _first(data, *LATITUDE), "longitude_deg": _first(data, *LONGITUDE)}
    columns["altitude_m"] = np.where(data["fix_type"] >= 3, height, np.nan)
    for column, name in (("north_mps", "vel_n_m_s"), ("east_mps", "vel_e_m_s"), ("down_mps", "vel_d_m_s")):
        if name in data:
            columns[column] = np.asarray(data[name], dtype=float)
    converted.add(t[fixed], **{name: values[fixed] for name, values in columns.items()})
    heading = np.asarray(data.get("heading", np.full(len(t), np.nan)), dtype=float)
    measured = np.isfinite(heading)
    converted.add(t[measured], heading_deg=np.degrees(heading[measured]) % 360.0)
    return bool(measured.any())
