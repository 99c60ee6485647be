"""From files to findings, and from a belief to a simulated motion: nothing here needs a drive."""

from __future__ import annotations

import os

import numpy as np

from schwung import drivetrain
from schwung import session as recording
from schwung.api.shown import as_shown
from schwung.api.values import (
    Estimate,
    InertiaTable,
    Machine,
    Session,
    Simulated,
    estimate_shown,
    machine_shown,
    session_shown,
)
from schwung.drivetrain import FeedForward
from schwung.estimation import Inversion
from schwung.estimation import estimate as estimate_session
from schwung.motion import Excitation, Motion
from schwung.session.gains import with_recorded_gains


def read_session(path: str | os.PathLike[str]) -> Session:
    """Read a recorded session, an HDF5 file as `schwung commission` and `schwung import` write it.

    Args:
        path: the file.

    Returns its runs; arrays have shape (n,) in rad, rad/s and N·m (on a linear axis m, m/s and N).
    Raises InputError, naming file, place in it and remedy, where the file is not what it should be.

    >>> schwung.read_session(session_file).axis
    'rotary'
    """
    return session_shown(recording.read_session(path))


def load_machine(path: str | os.PathLike[str]) -> Machine:
    """Read a belief, `machine.toml`, and the tables that it names.

    Args:
        path: the file. Its keys are SI: kg·m², N·m, N·m/rad, N·m·s/rad, s, Hz; tables have shape (n,).

    Raises InputError that names file, key, defect and unit.

    >>> schwung.load_machine("none.toml")
    Traceback (most recent call last):
    schwung.errors.InputError: none.toml: cannot be read: no such file or directory. Give the path of a machine.toml.
    """
    return machine_shown(drivetrain.load_machine(os.fspath(path)))


def write_machine(machine: drivetrain.Machine, path: str | os.PathLike[str]) -> None:
    """Write a belief as `machine.toml` and its tables beside it, whole or not at all.

    Args:
        machine: SI (kg·m², N·m, …); tables, shape (n,), become `<stem>_inertia.csv` and `<stem>_load_torque.csv`.
        path: the file; `load_machine` gives the same machine again.

    Raises InputError where it cannot be written.

    >>> schwung.write_machine(schwung.example_machine(), folder / "machine.toml")
    >>> schwung.load_machine(folder / "machine.toml").load.inertia_kgm2
    0.11
    """
    drivetrain.write_machine(machine, os.fspath(path))


def read_inertia(path: str | os.PathLike[str]) -> InertiaTable:
    """Read an inertia table, `inertia.csv`: position_rad (rad), inertia_kgm2 (kg·m²), std_kgm2 (kg·m², optional).

    Args:
        path: the file; columns become arrays of shape (n,).

    Raises InputError that names file, line and remedy.

    >>> from pathlib import Path
    >>> _ = Path("table.csv").write_text("position_rad,inertia_kgm2\\n0,0.1\\n1,0.3\\n")
    >>> schwung.read_inertia("table.csv").inertia_kgm2
    array([0.1, 0.3])
    """
    return as_shown(InertiaTable, drivetrain.read_inertia_csv(os.fspath(path)))


def write_inertia(table: drivetrain.InertiaTable, path: str | os.PathLike[str]) -> None:
    """Write an inertia table as `inertia.csv`, whole or not at all, without loss of digits.

    Args:
        table: rad and kg·m², (n,).
        path: the file; `read_inertia` gives the same table again.

    Raises InputError where it cannot be written.

    >>> import numpy as np
    >>> schwung.write_inertia(schwung.InertiaTable(np.array([0.0, 1.0]), np.array([0.1, 0.3])), folder / "inertia.csv")
    """
    drivetrain.write_inertia_csv(table, os.fspath(path))


def example_machine(*, control: bool = False) -> Machine:
    """What an engineer would know of the demo's machine before it is measured: data sheets, and a guess of the load.

    Args:
        control: with the gains that the demo's drive holds (a real one is asked for them): then it can be simulated.

    Returns a belief in SI: inertias in kg·m², stiffness in N·m/rad; its load is one number, no table of shape (n,).
    Raises nothing.

    >>> schwung.example_machine().motor.peak_torque_nm
    233.0
    """
    gains = drivetrain.paper_machine().control if control else None
    return Machine(
        name="Slider-crank",
        motor=drivetrain.Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=drivetrain.Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=drivetrain.Load(viscous_friction_nms=0.1, inertia_kgm2=0.11),
        control=gains,
    )


def estimate(
    session: recording.Session,
    machine: drivetrain.Machine,
    *,
    method: str = "auto",
    inversion: Inversion = "complex",
    frequency_hz: float | None = None,
    points: int | None = None,
) -> Estimate:
    """Estimate the load inertia over the load angle from every excited run of a session.

    Args:
        session: as `read_session` gives it; arrays (n,), rad, rad/s, N·m.
        machine: the belief; gains that it lacks are taken from the session, where that holds them.
        method: "auto" takes the best that the session allows; "multiphase", "trajectory", "denoised", "former" or a
            rival.
        inversion: "complex" or "magnitude", where the method inverts (Ceulemans et al. 2024, equations 12 to 14).
        frequency_hz: of one excitation (Hz); None: all, each with the weight that it deserves.
        points: of the table, at most; None: as many as the recording resolves.

    Returns table (rad, kg·m², (n,)), its band and the verdict on its trust.
    Raises InputError naming run, problem and remedy: reference or phase missing, sine too weak, torque of the wrong
    sign.

    >>> found = schwung.estimate(schwung.read_session(session_file), schwung.example_machine())
    >>> found.trust.verdict, found.table.inertia_kgm2.shape == found.table.position_rad.shape
    ('good', True)
    """
    believed = with_recorded_gains(machine, session)
    return estimate_shown(
        estimate_session(session, believed, method, inversion, frequency_hz=frequency_hz, points=points)
    )


def simulate(
    machine: drivetrain.Machine,
    motion: Motion,
    *,
    excitation: Excitation | None = None,
    sample_rate_hz: float = 1000.0,
    start_rad: float = 0.0,
    feed_forward: FeedForward | None = None,
) -> Simulated:
    """Simulate a motion of the machine as believed, under its drive: what it would look like before anything moves.

    Args:
        machine: with [control], and with a load inertia.
        motion: rest to rest, in rad and s.
        excitation: the injected torque (Hz, N·m); None: none.
        sample_rate_hz: at which the motion is sampled and the torque sent (Hz).
        start_rad: where the motor stands at first (rad); tables are over absolute angles.
        feed_forward: what the drive adds by itself; None: nothing.

    Returns what the drive would report, arrays (n,) in s, rad, rad/s and N·m.
    Raises InputError where the machine cannot be simulated: unknown inertia, no control, terms that do not fit it.

    >>> motion = schwung.Motion(kind="third", distance_rad=3.14, duration_s=0.25)
    >>> round(schwung.simulate(schwung.example_machine(control=True), motion).peak_speed_rad_s)
    20
    """
    time = motion.time(sample_rate_hz)
    added = np.zeros_like(time) if excitation is None else excitation.torque(time)
    return as_shown(
        Simulated,
        drivetrain.simulate(
            machine, motion.demand(time), time, added, feed_forward=feed_forward, start_rad=start_rad,
            hold_torque_added=True,
        ),
    )  # fmt: skip
