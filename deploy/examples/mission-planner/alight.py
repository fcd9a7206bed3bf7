"""Sends an order from Mission Planner, whose Scripts page runs this file, to Alight. ORDER selects the order.

LAND lands the drone on the vessel, ABORT breaks the landing off, HOLD holds until the next order, KEEP keeps PLACE next to the
vessel.
"""
import clr

clr.AddReference("MAVLink")
import MAVLink

LAND, ABORT, HOLD = MAVLink.MAV_CMD.USER_1, MAVLink.MAV_CMD.USER_2, MAVLink.MAV_CMD.USER_3
KEEP = MAVLink.MAV_CMD.USER_4
ORDER = LAND
PLACE = (0, 0, 20, 0)  # height (m, 0: the approach's), ahead, to starboard (m), time (min, 0: 10)
COMPANION = 191  # MAV_COMP_ID_ONBOARD_COMPUTER

taken = MAV.doCommand(MAV.sysid, COMPANION, ORDER, *PLACE, 0, 0, 0)
print("taken" if taken else "NOT TAKEN: the messages say why")
