"""Other people's simulators: a machine, with what was learned about it, as FMU, Modelica model or MATLAB function.

`exported.py` is what an export tells of a machine; `fmu.py`, `modelica.py` and `matlab.py` write it.
"""
