"""Orders of Mission Planner to Alight: its Scripts page runs this file. Choose one by ORDER.

LAND lands the drone on the vessel, ABORT breaks the landing off, HOLD holds until the next order.
"""
import clr

clr.AddReference("MAVLink")
import MAVLink

LAND, ABORT, HOLD = MAVLink.MAV_CMD.USER_1, MAVLink.MAV_CMD.USER_2, MAVLink.MAV_CMD.USER_3
ORDER = LAND
COMPANION = 191  # MAV_COMP_ID_ONBOARD_COMPUTER

taken = MAV.doCommand(MAV.sysid, COMPANION, ORDER, 0, 0, 0, 0, 0, 0, 0)
print("taken" if taken else "NOT TAKEN: the messages say why")
