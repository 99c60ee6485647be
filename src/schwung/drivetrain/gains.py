"""A machine whose file says nothing of its controller, with the gains that the drive itself holds."""

from __future__ import annotations

from collections.abc import Mapping

from schwung.drivetrain.machine import Control, Machine
from schwung.errors import InputError


def with_control(machine: Machine, gains: Mapping[str, float]) -> Machine:
    """The machine with the gains that the drive holds, where the file has none.

    Raises InputError where neither knows them: the motion could not be simulated before it is made.
    """
    if machine.control is not None:
        return machine
    wanted = ("position_gain", "speed_gain", "speed_integral_time")
    if any(key not in gains for key in wanted):
        machine.required_control()
    try:
        control = Control(
            position_gain_per_s=gains["position_gain"],
            speed_gain_nms=gains["speed_gain"],
            speed_integral_time_s=gains["speed_integral_time"],
            sample_rate_hz=gains.get("sample_rate", 8000.0),
        )
    except ValueError as error:
        raise InputError("drive gains", str(error), "Give [control] in the machine file.") from error
    return machine.model_copy(update={"control": control})
