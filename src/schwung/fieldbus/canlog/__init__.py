"""A log of somebody's commissioning on CANopen -> the session that it was. Reads only; knows no bus.

observed.py  SDO transfers in the log: what the node's objects held, and when
decoding.py  PDOs by the mapping that held when they were sent, one row per SYNC
scaling.py   what a count is worth: from the log, a DCF, a profile, or as said
injection.py the sine that was added to the torque, and the motion that was demanded, from commanded counts
runs.py      motions found in the rows
build.py     all of it
"""

from schwung.fieldbus.canlog.build import LogRecipe, import_can_log

__all__ = ["LogRecipe", "import_can_log"]
