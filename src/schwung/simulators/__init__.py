"""Other people's simulators: what was learned goes there, and theirs may be the belief.

Out: `exported.py` is what an export tells of a machine; `fmu.py`, `modelica.py` and `matlab.py` write it. In: an FMU is
played, never looked into; `belief.py` is the way in, `player.py` the process in which it may crash.
"""
