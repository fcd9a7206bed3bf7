#!/usr/bin/env python3
"""A predictor for `alight trial --predictor "exec:python3 hold_deck.py"`: the deck stays as it is now.

Height and attitude are those of the first stage of the drone's own forecast, the horizontal velocity is constant, and the
standard deviations grow with the time ahead.
"""

import json
import sys

HEAVE_M, TILT_RAD = 0.3, 0.06  # of the deck about its mean, standard deviations
RATE = 1.5  # of the waves, rad/s


def predicted(stages, step_s):
    now = stages[0]
    for k in range(len(stages)):
        t = k * step_s
        unknown = min(1.0, RATE * t)
        north, east, _ = now["velocity"]
        yield now | {
            "position": [now["position"][0] + north * t, now["position"][1] + east * t, now["position"][2]],
            "velocity": [north, east, 0.0],
            "acceleration": [0.0, 0.0, 0.0],
            "euler_rates": [0.0, 0.0, now["euler_rates"][2]],
            "position_sd": [s + HEAVE_M * unknown for s in now["position_sd"]],
            "velocity_sd": [s + HEAVE_M * RATE for s in now["velocity_sd"]],
            "euler_sd": [s + TILT_RAD * unknown for s in now["euler_sd"]],
            "euler_rates_sd": [s + TILT_RAD * RATE for s in now["euler_rates_sd"]],
        }


for line in sys.stdin:
    forecast = json.loads(line)["forecast"]
    stages = list(predicted(forecast["stages"], forecast["step_s"]))
    print(json.dumps({"version": 1, "stages": stages}), flush=True)
