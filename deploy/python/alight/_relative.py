"""Motion of the drone relative to the deck."""

from __future__ import annotations

import re
from typing import Any, Dict

from ._lazy import numpy as np
from ._program import AlightError
from ._run import Run


def relative(run: Run) -> Dict[str, Any]:
    """Returns the motion of drone and deck at common times.

    time_s             time as in `run.series`
    to_touchdown_s     time since the first contact, s; NaN without a landing
    drone_m, deck_m    positions of the drone and of the deck's centre: north, east, down, N x 3
    drone_mps, deck_mps  velocities: north, east, down, N x 3
    drone_deg, deck_deg  attitudes: roll, pitch, yaw, N x 3
    displacement_m     from the deck's centre to the centroid of the drone's feet in the deck's axes: forward, starboard,
                       and height above the deck (up), N x 3; the first two give `position_error_m` at the first contact
    roll_deg, pitch_deg, yaw_deg   attitude of the drone in the deck's axes: drone minus deck
    source             "truth" for a simulated landing; "belief" for a flight, whose truth is unknown: the drone's odometry
                       and the deck's present pose by its forecast, in the odometry's own NED
    """
    found = _true(run.series["/truth"]) if "/truth" in run.series else _believed(run)
    touchdown = run.touchdown_s() if "/mission" in run.series else None
    found["to_touchdown_s"] = found["time_s"] - (np.nan if touchdown is None else touchdown)
    return found


def configured(run: Run, key: str, default: float) -> float:
    """Returns the number of a key in the attached configurations."""
    found = re.search(rf"^{key} = ([0-9.]+)", "\n".join(run.files.values()), re.M)
    return float(found.group(1)) if found else default


def _true(truth: Dict[str, Any]) -> Dict[str, Any]:
    def columns(*names):
        return np.column_stack([truth[name] for name in names])

    return {
        "time_s": truth["time_s"],
        # Heights in `/truth` are positive upwards.
        "drone_m": columns("drone_north_m", "drone_east_m", "drone_height_m") * (1.0, 1.0, -1.0),
        "deck_m": columns("deck_north_m", "deck_east_m", "deck_heave_m") * (1.0, 1.0, -1.0),
        "drone_mps": truth["drone_velocity_mps"],
        "deck_mps": truth["deck_velocity_mps"],
        "drone_deg": columns("drone_roll_deg", "drone_pitch_deg", "drone_yaw_deg"),
        "deck_deg": columns("deck_roll_deg", "deck_pitch_deg", "deck_yaw_deg"),
        "displacement_m": columns("forward_m", "starboard_m", "height_above_deck_m"),
        **{f"{angle}_deg": truth[f"{angle}_error_deg"] for angle in ("roll", "pitch", "yaw")},
        "source": "truth",
    }


def _believed(run: Run) -> Dict[str, Any]:
    for topic in ("/drone/odometry", "/deck/forecast/path"):
        if topic not in run.series:
            raise AlightError(
                f"no {topic} and no truth in {run.path or 'this run'}: a flight of the drone's computer, or a recording of "
                "a trial, tells where drone and deck are"
            )
    odometry, forecast = run.topic("/drone/odometry"), run.topic("/deck/forecast/path")
    times = forecast["time_s"]
    inside = (times >= odometry["time_s"][0]) & (times <= odometry["time_s"][-1])
    time_s = times[inside]
    if len(time_s) < 2:
        raise AlightError(f"forecast and odometry of {run.path or 'this run'} have no time in common")
    # The forecast's first pose is the deck at the forecast's own time.
    deck_m, q_deck = forecast["position_m"][inside, 0], forecast["quaternion_wxyz"][inside, 0]
    drone_m, q_drone = _at(time_s, odometry)
    body_mps = _interpolated(time_s, odometry["time_s"], odometry["body_velocity_mps"])
    offset = _turn(_inverse(q_deck), drone_m - deck_m)
    return {
        "time_s": time_s,
        "drone_m": drone_m,
        "deck_m": deck_m,
        "drone_mps": _turn(q_drone, body_mps),
        # A forecast has no velocities, so its positions are differentiated.
        "deck_mps": np.gradient(deck_m, time_s, axis=0),
        "drone_deg": np.column_stack(_euler_deg(q_drone)),
        "deck_deg": np.column_stack(_euler_deg(q_deck)),
        **_seen_from_deck(offset, q_drone, q_deck, configured(run, "feet_below_m", 0.0)),
        "source": "belief",
    }


def _seen_from_deck(offset, q_drone, q_deck, feet_m: float) -> Dict[str, Any]:
    q = _times(_inverse(q_deck), q_drone)
    below = np.zeros_like(offset)
    below[:, 2] = feet_m
    feet = offset + _turn(q, below)
    roll, pitch, yaw = _euler_deg(q)
    return {
        "displacement_m": feet * np.array([1.0, 1.0, -1.0]),
        "roll_deg": roll,
        "pitch_deg": pitch,
        "yaw_deg": yaw,
    }


def _euler_deg(q):
    """Roll, pitch and yaw (ZYX), deg."""
    w, x, y, z = q.T
    angles = (
        np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)),
        np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )
    return [np.degrees(angle) for angle in angles]


def _at(time_s, series):
    """Interpolates the positions and attitudes of a series."""
    q = series["quaternion_wxyz"].copy()
    # q and -q are the same attitude; interpolation between neighbours of opposite sign would pass through zero.
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))
    q[1:] *= flips[:, None]
    q = _interpolated(time_s, series["time_s"], q)
    return _interpolated(time_s, series["time_s"], series["position_m"]), q / np.linalg.norm(q, axis=1, keepdims=True)


def _interpolated(time_s, times, values):
    return np.column_stack([np.interp(time_s, times, column) for column in values.T])


def _inverse(q):
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def _times(a, b):
    """Quaternion product: first rotation b, then a."""
    v = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    w = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    return np.hstack([w, v])


def _turn(q, v):
    """Rotates vectors from body axes to the frame."""
    t = 2 * np.cross(q[:, 1:], v)
    return v + q[:, :1] * t + np.cross(q[:, 1:], t)
