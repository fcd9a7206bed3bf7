"""A planner in a separate program: alight trial --sea calm --planner "exec:python3 pd_descent.py"

A plain PD law that flies towards the deck's present position, ignoring its motion, and descends at the permitted speed. The common
planner flies to the vessel.
"""

import json
import math
import sys

VERSION = 1
GRAVITY = 9.81
STEP_S, STAGES = 0.05, 21
KP, KD = 1.0, 1.8  # 1/s², 1/s
LIMIT = 4.0  # m/s²


def euler(acceleration, yaw):
    """Roll, pitch, yaw of a body whose thrust produces this acceleration (NED)."""
    north, east, down = acceleration
    up = GRAVITY - down
    forward = math.cos(yaw) * north + math.sin(yaw) * east
    right = -math.sin(yaw) * north + math.cos(yaw) * east
    return [math.atan2(right, math.hypot(forward, up)), math.atan2(-forward, up), yaw]


def plan(ask):
    """Stages that begin at the drone's measured state."""
    mission, drone, forecast = ask["mission"], ask["drone"], ask["forecast"]
    target = list(forecast["stages"][0]["position"])
    descent = mission["descent_mps"] if mission["phase"] == "Landing" else 0.0
    if descent == 0.0:
        target[2] = forecast["mean_z"] - mission["height_m"]
    position, velocity = list(drone["position"]), list(drone["velocity"])
    stages = []
    for _ in range(STAGES):
        acceleration = []
        for axis in range(3):
            pull = KP * (target[axis] - position[axis]) - KD * velocity[axis]
            if axis == 2 and descent > 0.0:
                pull = KD * (descent - velocity[2])
            acceleration.append(max(-LIMIT, min(LIMIT, pull)))
        stages.append(
            {
                "position": list(position),
                "velocity": list(velocity),
                "acceleration": acceleration,
                "euler": euler(acceleration, drone["euler"][2]),
            }
        )
        for axis in range(3):
            velocity[axis] += STEP_S * acceleration[axis]
            position[axis] += STEP_S * velocity[axis]
    return {"step_s": STEP_S, "stages": stages, "solve_s": 0.005}


def answer(ask):
    """Answer to one input."""
    if ask["version"] != VERSION:
        return {"none": f"input of version {ask['version']}"}
    if ask["mission"]["phase"] == "Navigation":
        return {"common": True}
    if not ask["forecast"] or ask["forecast"]["mean_z"] is None:
        return {"none": "no forecast"}
    return plan(ask)


for line in sys.stdin:
    print(json.dumps({"version": VERSION, **answer(json.loads(line))}), flush=True)
