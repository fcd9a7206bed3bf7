#!/usr/bin/env python3
"""Shows a landing as a ground station receives it, with pymavlink (pip install pymavlink==2.4.50).

    python3 ground_station.py udpin:0.0.0.0:14550 &
    alight land --ground-station 127.0.0.1:14550

Prints the companion's messages: the number of heartbeats, each text, and the named values once a second. With --switch it
moves the switch of the remote control (autopilot.rc_switch) by RC_CHANNELS_OVERRIDE: "7: 1500@0 2000@20 1000@40" puts
channel 7 to 1500 us at once, to 2000 after 20 s and to 1000 after 40 s. With --order it commands the companion as the actions
of deploy/examples/qgroundcontrol do: "abort@30 land@45", and prints each answer. With --set it reads the companion's
parameters and sets them: "ALIGHT_MODE=1@5" after 5 s.
"""
import argparse
import time

from pymavlink import mavutil

COMPANION = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
# MAV_CMD_USER_1 to 4 and MAV_CMD_NAV_TAKEOFF
ORDERS = {"land": 31010, "abort": 31011, "hold": 31012, "station": 31013, "takeoff": 22}
USUAL = [float("nan")] * 4  # position and time of a station; no other order has parameters


def switch(text):
    channel, steps = text.split(":")
    return int(channel), [(float(at), int(us)) for us, at in (step.split("@") for step in steps.split())]


def orders(text):
    steps = [step.split("@") for step in text.split()]
    return [(float(at), name, ORDERS[name]) for name, at in steps]


def settings(text):
    steps = [step.split("@") for step in text.split()]
    return [(float(at), *pair.split("=")) for pair, at in steps]


def name_of(enum, value):
    known = mavutil.mavlink.enums[enum]
    return known[value].name.removeprefix(f"{enum}_") if value in known else str(value)


def turn(link, system, channel, pulse_us):
    pulses = [0] * 8
    pulses[channel - 1] = pulse_us
    link.mav.rc_channels_override_send(system, 1, *pulses)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("url", help="as pymavlink names it: udpin:0.0.0.0:14550, /dev/ttyUSB0")
    arguments.add_argument("--for", dest="seconds", type=float, default=120.0, help="ends after so many seconds")
    arguments.add_argument("--switch", type=switch, help="positions of the remote control's switch, by time")
    order = "land, abort, hold, station and takeoff, by time: \"abort@30\""
    arguments.add_argument("--order", type=orders, default=[], help=order)
    arguments.add_argument("--set", type=settings, default=[], help="parameters of the companion: \"ALIGHT_MODE=1@5\"")
    options = arguments.parse_args()

    # The default dialect of pymavlink is ArduPilot's, which contains `common`.
    link = mavutil.mavlink_connection(options.url, source_system=255)
    began, heartbeats, values, shown, system = time.monotonic(), 0, {}, 0.0, None
    channel, steps = options.switch or (0, [])
    pulse_us, sent, listed, begun = None, 0.0, not options.set, ""
    while (elapsed := time.monotonic() - began) < options.seconds:
        while steps and steps[0][0] <= elapsed and system is not None:
            pulse_us = steps.pop(0)[1]
            print(f"{elapsed:6.1f}  RC_CHANNELS_OVERRIDE channel {channel}: {pulse_us} us", flush=True)
        if pulse_us and elapsed - sent > 0.1:
            turn(link, system, channel, pulse_us)
            sent = elapsed
        while options.order and options.order[0][0] <= elapsed and system is not None:
            _, name, number = options.order.pop(0)
            print(f"{elapsed:6.1f}  COMMAND_LONG {number}: {name}", flush=True)
            link.mav.command_long_send(system, COMPANION, number, 0, *USUAL, 0, 0, 0)
        if not listed and system is not None:
            listed = True
            link.mav.param_request_list_send(system, COMPANION)
        while options.set and options.set[0][0] <= elapsed and system is not None:
            _, name, value = options.set.pop(0)
            print(f"{elapsed:6.1f}  PARAM_SET {name}: {value}", flush=True)
            kind = mavutil.mavlink.MAV_PARAM_TYPE_REAL32
            link.mav.param_set_send(system, COMPANION, name.encode(), float(value), kind)
        message = link.recv_match(blocking=True, timeout=0.1)
        if message is None or message.get_srcComponent() != COMPANION:
            continue
        system, kind = message.get_srcSystem(), message.get_type()
        if kind == "HEARTBEAT":
            heartbeats += 1
            if heartbeats == 1:
                print(
                    f"{elapsed:6.1f}  HEARTBEAT of {system}/{COMPANION}: type {message.type} "
                    f"(18: onboard controller), autopilot {message.autopilot} (8: invalid), "
                    f"status {message.system_status} (4: active)",
                    flush=True,
                )
        elif kind == "STATUSTEXT":
            severity = name_of("MAV_SEVERITY", message.severity)
            begun += message.text
            # A long text arrives in chunks, the last of which is not full.
            if not message.id or len(message.text) < 50:
                print(f"{elapsed:6.1f}  STATUSTEXT {severity:<8} {begun}", flush=True)
                begun = ""
        elif kind == "COMMAND_ACK":
            print(f"{elapsed:6.1f}  COMMAND_ACK {message.command}: {name_of('MAV_RESULT', message.result)}", flush=True)
        elif kind == "PARAM_VALUE":
            print(f"{elapsed:6.1f}  PARAM_VALUE {message.param_id}: {message.param_value:g}", flush=True)
        elif kind == "NAMED_VALUE_FLOAT":
            values[message.name] = message.value
            if elapsed - shown >= 1.0:
                shown = elapsed
                text = ", ".join(f"{name} {value:.2f}" for name, value in sorted(values.items()))
                print(f"{elapsed:6.1f}  NAMED_VALUE_FLOAT {text}", flush=True)
    print(f"{heartbeats} heartbeats of the companion in {options.seconds:.0f} s")


if __name__ == "__main__":
    main()
