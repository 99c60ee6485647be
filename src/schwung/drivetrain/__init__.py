"""What a machine is: parameters, inertia over angle, frequency response, fast simulation. Beliefs, not truths."""

from schwung.drivetrain.inertia import (
    Deviation,
    InertiaTable,
    LoadTorqueTable,
    deviation,
    read_inertia_csv,
    read_load_torque_csv,
    slider_crank_inertia,
    write_inertia_csv,
)
from schwung.drivetrain.machine import (
    Control,
    Coupling,
    Electrical,
    Load,
    Machine,
    Motor,
    load_machine,
    machine_files,
    paper_machine,
    write_machine,
)
from schwung.drivetrain.response import anti_resonance_hz, disturbance_to_position_ratio, resonance_hz
from schwung.drivetrain.simulation import FeedForward, Simulated, simulate

__all__ = [
    "Control",
    "Coupling",
    "Deviation",
    "Electrical",
    "FeedForward",
    "InertiaTable",
    "Load",
    "LoadTorqueTable",
    "Machine",
    "Motor",
    "Simulated",
    "anti_resonance_hz",
    "deviation",
    "disturbance_to_position_ratio",
    "load_machine",
    "machine_files",
    "paper_machine",
    "read_inertia_csv",
    "read_load_torque_csv",
    "resonance_hz",
    "simulate",
    "slider_crank_inertia",
    "write_inertia_csv",
    "write_machine",
]
