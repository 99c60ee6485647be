"""A machine as a model of other simulators: FMU, Modelica, MATLAB."""

from __future__ import annotations

from schwung.simulators.fmu import check_fmi, write_fmu
from schwung.simulators.matlab import write_matlab
from schwung.simulators.modelica import write_modelica

__all__ = [
    "check_fmi",
    "write_fmu",
    "write_matlab",
    "write_modelica",
]
