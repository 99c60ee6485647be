"""Every learned term against an independent truth: the bench's two-mass plant that conceals the same effect.

The closed-loop simulation says which torque the drive commands. Stepped through that torque, the plant of the virtual
machine room (its own equations, integrator and stiction) has to make the same motion; and the torque has to be what the
paper's cascade makes of the motion that the drive reads. Both together are the closed loop. The neutral plant under the
same torque has to move clearly otherwise, so that each comparison can fail.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from schwung.drivetrain.effects import PHYSICS
from schwung.drivetrain.inertia import InertiaTable, slider_crank_inertia
from schwung.drivetrain.machine import Load, Machine, paper_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.simulation import Simulated, simulate
from schwung.errors import InputError
from schwung.motion import Array, Excitation, Motion
from schwung_sim.plants import Concealed, TwoMassPlant
from schwung_sim.plants.two_mass import TICK_S

TIME = np.arange(4001) * TICK_S
MOTION = Motion(kind="poly5", distance_rad=3.0, duration_s=0.2, start_time_s=0.02, returns=True, dwell_s=0.02)
ADDED = Excitation(frequency_hz=50, amplitude_nm=25.0).torque(TIME)
SEED = 3
#: The bench's plant takes so many steps in a tick, not its usual four, that the truth is the nearer.
SUBSTEPS = 8

#: Speed (rad/s) and angle (rad) within which smooth physics agrees; the strokes reach 34 rad/s.
SMOOTH = (1e-4, 5e-6)
#: Where dry friction holds the shaft, the smooth tanh creeps at up to some 0.05 rad/s.
DRY = (0.1, 3e-3)
#: Where play closes, the coupling's torque has a corner for any step to meet.
CONTACT = (2e-2, 2e-5)
#: A late speed is read between ticks, on a straight line.
BETWEEN_TICKS = (2e-3, 5e-6)


@dataclass(frozen=True)
class Case:
    """One term's parameters, and how close (rad/s, rad) the truth has to be."""

    parameters: Mapping[str, float]
    close: tuple[float, float] = SMOOTH


#: Steps per tick against which the usual ones are held where those are more than 6: of fourth order, twice as many err
#: by a sixteenth.
FINER = {"local_friction": 30, "backlash": 30}

#: What the bench does not conceal: test_residual_terms.py holds these against the balance of momentum.
BALANCED = (
    "friction_over_angle", "viscous_drift", "load_dependent_friction", "load_side_friction", "presliding_friction",
    "direction_dependent_load", "end_spring", "encoder_harmonic", "kinematic_error", "offset_drift",
    "coupling_hysteresis", "torque_constant_drop", "torque_constant_fade", "torque_ripple", "torque_filter",
    "stiffness_over_angle", "motor_inertia",
    "inertia_profile", "residual",
)  # fmt: skip

CASES = {
    "coulomb_friction": Case({"torque_nm": 5.0}, DRY),
    "stribeck_friction": Case(
        {"coulomb_torque_nm": 3.0, "breakaway_torque_nm": 8.0, "stribeck_speed_rad_s": 3.0}, DRY
    ),
    "asymmetric_friction": Case({"torque_positive_nm": 6.0, "torque_negative_nm": 2.0}, DRY),
    "viscous_friction": Case({"coefficient_nms": 0.3}),
    "quadratic_drag": Case({"coefficient_nms2": 0.02}),
    "local_friction": Case({"torque_nm": 20.0, "centre_rad": 1.2, "width_rad": 0.6}),
    "friction_drift": Case({"change_nm": 4.0}, DRY),
    "load_torque": Case({"amplitude_nm": 12.0, "phase_rad": 0.7}),
    "torque_offset": Case({"torque_nm": 4.0}),
    "load_event": Case({"time_s": 0.05, "duration_s": 0.03, "peak_nm": 40.0}),
    "periodic_disturbance": Case({"frequency_hz": 32.0, "amplitude_nm": 6.0}),
    "cogging": Case({"order": 12.0, "amplitude_nm": 5.0, "phase_rad": 0.4}),
    "torque_constant": Case({"gain": 0.9}),
    "torque_lag": Case({"time_constant_s": 1e-3}),
    "torque_saturation": Case({"limit_nm": 100.0}),
    "measurement_delay": Case({"delay_s": 5.3e-4}, BETWEEN_TICKS),
    "encoder_eccentricity": Case({"amplitude_rad": 4e-3}),
    "backlash": Case({"gap_rad": 4e-3}, CONTACT),
    "coupling_stiffness": Case({"stiffness_nm_rad": 9000.0}),
    "coupling_damping": Case({"damping_nms": 40.0}),
    "nonlinear_stiffness": Case({"cubic_nm_rad3": 3e9}),
    "extra_compliance": Case({"inertia_kgm2": 0.03, "stiffness_nm_rad": 4000.0, "damping_nms": 1.5}),
    "load_inertia": Case({"delta_kgm2": 0.03, "scale": 1.1}),
    "inertia_profile_shift": Case({"shift_rad": 0.2}),
}


def _term(name: str, **parameters: Any) -> PhysicsTerm:
    return PhysicsTerm.model_validate({"name": name, **parameters})


@cache
def _machine() -> Machine:
    """The paper's, as the bench conceals it: its inertia goes on over whole turns; gains that settle everywhere."""
    paper = paper_machine()
    angle = np.linspace(-2.0, 6.0, 4001)
    load = Load(viscous_friction_nms=0.1, inertia_table=InertiaTable(angle, slider_crank_inertia(angle)))
    control = paper.required_control().model_copy(update={"speed_integral_time_s": 0.02})
    return paper.model_copy(update={"load": load, "control": control})


def _simulated(*terms: PhysicsTerm, share: float = 1.0, machine: Machine | None = None) -> Simulated:
    machine = (machine or _machine()).model_copy(update={"physics": terms})
    return simulate(machine, MOTION.demand(TIME), TIME, ADDED, session_share=share)


def _phase() -> float:
    """The bench draws the phase of its periodic disturbance from the seed."""
    return float(np.random.default_rng([SEED, 1]).uniform(0, 2 * np.pi))


@cache
def _simulated_alone(name: str) -> Simulated:
    parameters = dict(CASES[name].parameters)
    if name == "periodic_disturbance":
        parameters["phase_rad"] = _phase()
    return _simulated(_term(name, **parameters))


@dataclass(frozen=True, eq=False)
class Truth:
    """What the bench's plant did, as a drive would read it, (n,)."""

    position_rad: Array
    speed_rad_s: Array
    load_speed_rad_s: Array


def _truth(effects: Mapping[str, Mapping[str, Any]], made: Simulated, motions: int = 1) -> Truth:
    """The bench's plant with these effects under the torque that the simulation reports, from the same standstill."""
    plant = TwoMassPlant(concealed=Concealed(effects), seed=SEED)
    plant.parameters["substeps"], plant.parameters["substep_s"] = SUBSTEPS, TICK_S / SUBSTEPS
    plant.state["load_rad"] = plant.state["third_rad"] = made.load_position_rad[0]
    plant.state["true_torque_nm"] = plant.parameters["torque_gain"] * made.torque_nm[0]
    begins = round(MOTION.start_time_s / TICK_S)
    plant.state["motions"] = motions
    columns = np.zeros((TIME.size, 3))
    for i, torque in enumerate(made.torque_nm):
        if i == begins:
            plant.state["motion_time_s"] = 0.0
        state = plant.state[0]
        columns[i] = state["motor_rad"], state["motor_rad_s"], state["load_rad_s"]
        plant.step(float(torque))
    angle, speed, load_speed = columns.T
    eccentric, late = plant.sensor.eccentricity_rad, plant.sensor.speed_delay_s
    speed = speed * (1 + eccentric * np.cos(angle))
    if late > 0:
        speed = np.where(late < TIME, CubicSpline(TIME, speed)(np.maximum(TIME - late, 0)), speed[0])
    return Truth(angle + eccentric * np.sin(angle), speed, load_speed)


def _apart(truth: Truth, made: Simulated) -> tuple[float, float]:
    """Largest difference of speed (rad/s; motor and load) and angle (rad)."""
    speed = np.abs(truth.speed_rad_s - made.speed_rad_s)
    load = np.abs(truth.load_speed_rad_s - made.load_speed_rad_s)
    return float(np.max([speed, load])), float(np.max(np.abs(truth.position_rad - made.position_rad)))


def test_there_is_a_case_for_every_term() -> None:
    assert list(CASES) == [name for name in PHYSICS if name not in BALANCED]
    assert len(CASES) == 24


@pytest.mark.parametrize("name", CASES)
def test_the_bench_moves_alike_under_the_same_torque(name: str) -> None:
    made, case = _simulated_alone(name), CASES[name]
    concealed = dict(case.parameters) | ({"motions": 2.0} if name == "friction_drift" else {})
    speed_off, angle_off = _apart(_truth({name: concealed}, made, motions=2), made)
    assert speed_off < case.close[0]
    assert angle_off < case.close[1]
    without, _ = _apart(_truth({}, made), made)
    assert without > 40 * case.close[0]


@pytest.mark.parametrize("name", CASES)
def test_the_torque_is_what_the_cascade_makes_of_what_is_read(name: str) -> None:
    made, control = _simulated_alone(name), _machine().required_control()
    error = control.position_gain_per_s * made.following_error_rad - made.speed_rad_s
    before = np.concatenate([[0.0], np.cumsum(error)[:-1]])
    torque = control.speed_gain_nms * (error + before * TICK_S / control.speed_integral_time_s) + ADDED
    assert not np.any(made.clipped)
    # what the integrator held at rest: without load torque or offset nothing
    held = made.torque_nm[0] - torque[0]
    if name not in ("load_torque", "torque_offset", "cogging"):
        assert held == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(made.torque_nm, torque + held, atol=1e-7)


def test_terms_together() -> None:
    terms: dict[str, dict[str, float]] = {
        "viscous_friction": {"coefficient_nms": 0.2},
        "cogging": {"order": 6.0, "amplitude_nm": 3.0, "phase_rad": 1.0},
        "torque_constant": {"gain": 0.95},
        "torque_lag": {"time_constant_s": 4e-4},
        "encoder_eccentricity": {"amplitude_rad": 2e-3},
        "load_torque": {"amplitude_nm": -8.0, "phase_rad": 0.3},
        "extra_compliance": {"inertia_kgm2": 0.01, "stiffness_nm_rad": 3000.0, "damping_nms": 1.0},
        "coupling_stiffness": {"stiffness_nm_rad": 18000.0},
        "load_inertia": {"delta_kgm2": 0.01, "scale": 0.9},
    }
    made = _simulated(*(_term(name, **parameters) for name, parameters in terms.items()))
    speed_off, angle_off = _apart(_truth(terms, made), made)
    assert speed_off < 3 * SMOOTH[0]
    assert angle_off < 3 * SMOOTH[1]
    for left_out in terms:
        others = {name: parameters for name, parameters in terms.items() if name != left_out}
        assert _apart(_truth(others, made), made)[0] > 200 * SMOOTH[0], left_out


def test_a_learned_table_adds_to_the_machines_own_load_torque() -> None:
    table = [[0.0, 4.0], [1.0, -6.0], [3.0, 9.0]]
    load = _machine().load.model_copy(update={"torque_nm": -5.0})
    made = _simulated(_term("load_torque", table=table), machine=_machine().model_copy(update={"load": load}))
    both = tuple((angle, torque - 5.0) for angle, torque in table)
    speed_off, angle_off = _apart(_truth({"load_torque": {"table": both}}, made), made)
    assert speed_off < SMOOTH[0]
    assert angle_off < SMOOTH[1]
    alone = tuple((angle, torque) for angle, torque in table)
    assert _apart(_truth({"load_torque": {"table": alone}}, made), made)[0] > 1.0


def test_friction_drifts_evenly_from_the_first_run_to_the_last() -> None:
    drift, coulomb = _term("friction_drift", change_nm=4.0), _term("coulomb_friction", torque_nm=3.0)
    for share, level in ((0.0, 3.0), (0.25, 4.0), (1.0, 7.0)):
        drifted = _simulated(drift, coulomb, share=share)
        constant = _simulated(_term("coulomb_friction", torque_nm=level))
        np.testing.assert_allclose(drifted.speed_rad_s, constant.speed_rad_s, atol=1e-3)
    assert not np.allclose(_simulated(drift, coulomb).speed_rad_s, _simulated(coulomb).speed_rad_s, atol=1e-2)


def test_dry_friction_is_never_less_than_none() -> None:
    """A drift that takes away more than there is leaves no friction, and none that drives."""
    none = _simulated(_term("coulomb_friction", torque_nm=1.0), _term("friction_drift", change_nm=-4.0))
    np.testing.assert_allclose(none.speed_rad_s, _simulated().speed_rad_s, atol=1e-3)


def test_a_third_mass_behind_a_rigid_machine_makes_it_two_masses() -> None:
    paper = _machine()
    one = paper.model_copy(
        update={"coupling": None, "load": Load(viscous_friction_nms=0.1, inertia_kgm2=0.05)}
    )
    made = _simulated(
        _term("extra_compliance", inertia_kgm2=0.06, stiffness_nm_rad=8000.0, damping_nms=3.0), machine=one
    )
    assert paper.coupling is not None
    two = paper.model_copy(
        update={
            "motor": paper.motor.model_copy(update={"inertia_kgm2": 0.062, "viscous_friction_nms": 0.3}),
            "coupling": paper.coupling.model_copy(update={"stiffness_nm_rad": 8000.0, "damping_nms": 3.0}),
            "load": Load(inertia_kgm2=0.06),
        }
    )
    np.testing.assert_allclose(made.speed_rad_s, _simulated(machine=two).speed_rad_s, atol=1e-5)


def test_the_steps_are_short_enough_for_every_term() -> None:
    """On the way out, which has every event there is; the way back is as fast."""
    out = TIME[: TIME.size // 2]
    for name, case in CASES.items():
        made = _simulated_alone(name)
        parameters = dict(case.parameters) | (
            {"phase_rad": _phase()} if "frequency_hz" in case.parameters else {}
        )
        machine = _machine().model_copy(update={"physics": (_term(name, **parameters),)})
        steps = FINER.get(name, 12)
        finer = simulate(
            machine, MOTION.demand(out), out, ADDED[: out.size], session_share=1.0, substeps=steps
        )
        made_out = made.speed_rad_s[: out.size]
        np.testing.assert_allclose(made_out, finer.speed_rad_s, atol=case.close[0] / 2, err_msg=name)


class TestAtRest:
    """The simulation starts where nothing moves, whatever pulls."""

    STILL = Motion(distance_rad=0.1, duration_s=0.05, start_time_s=0.05)

    def _held(self, machine: Machine, *terms: PhysicsTerm, start_rad: float = 1.0) -> Simulated:
        before = np.arange(400) * TICK_S
        machine = machine.model_copy(update={"physics": terms})
        made = simulate(machine, self.STILL.demand(before), before, start_rad=start_rad)
        np.testing.assert_allclose(made.position_rad, start_rad, atol=1e-11)
        np.testing.assert_allclose(made.torque_nm, made.torque_nm[0], atol=1e-7)
        return made

    def test_the_drive_holds_what_pulls_on_both_shafts(self) -> None:
        made = self._held(
            _machine(),
            _term("load_torque", amplitude_nm=20.0, phase_rad=0.5),
            _term("torque_offset", torque_nm=-3.0),
            _term("cogging", order=5.0, amplitude_nm=2.0, phase_rad=0.2),
            _term("torque_constant", gain=0.8),
        )
        twist = made.position_rad[0] - made.load_position_rad[0]
        load = 20.0 * np.sin(made.load_position_rad[0] + 0.5)
        assert twist == pytest.approx(-load / 24963.0)
        assert made.torque_nm[0] * 0.8 == pytest.approx(-(load - 3.0 + 2.0 * np.sin(5.2)))

    def test_a_load_that_pulls_rests_on_one_side_of_the_play(self) -> None:
        table = [[0.0, -7.0], [2.0, -7.0]]
        stiffens = _term("nonlinear_stiffness", cubic_nm_rad3=1e10)
        made = self._held(
            _machine(), _term("backlash", gap_rad=0.02), stiffens, _term("load_torque", table=table)
        )
        wound = made.position_rad[0] - made.load_position_rad[0] - 0.01
        assert 24963.0 * wound + 1e10 * wound**3 == pytest.approx(7.0)

    def test_a_load_that_pulls_to_the_middle_rests_within_the_play(self) -> None:
        table = [[0.0, 1000.0], [2.0, -1000.0]]
        made = self._held(
            _machine(), _term("backlash", gap_rad=0.02), _term("load_torque", table=table), start_rad=1.005
        )
        assert made.load_position_rad[0] == pytest.approx(1.0, abs=1e-9)
        assert made.torque_nm[0] == pytest.approx(0.0, abs=1e-5)

    def test_a_rigid_machine(self) -> None:
        rigid = _machine().model_copy(update={"coupling": None})
        made = self._held(rigid, _term("load_torque", amplitude_nm=20.0, phase_rad=0.0))
        assert made.torque_nm[0] == pytest.approx(-20.0 * np.sin(1.0))

    def test_the_encoder_reads_the_demand(self) -> None:
        made = self._held(_machine(), _term("encoder_eccentricity", amplitude_rad=0.1, phase_rad=0.7))
        motor = made.load_position_rad[0]
        assert motor + 0.1 * np.sin(motor + 0.7) == pytest.approx(1.0)

    def test_the_encoder_reads_the_demand_with_both_its_errors_as_large_as_they_may_be(self) -> None:
        once = _term("encoder_eccentricity", amplitude_rad=0.5, phase_rad=0.7)
        made = self._held(
            _machine(), once, _term("encoder_harmonic", order=20.0, amplitude_rad=-0.025, phase_rad=1.2)
        )
        motor = made.load_position_rad[0]
        assert motor + 0.5 * np.sin(motor + 0.7) - 0.025 * np.sin(20 * motor + 1.2) == pytest.approx(
            1.0, abs=1e-12
        )

    def test_a_coupling_that_yields_is_said(self) -> None:
        softens = _term("nonlinear_stiffness", cubic_nm_rad3=-1e9)
        machine = _machine().model_copy(
            update={"load": _machine().load.model_copy(update={"torque_nm": 200.0})}
        )
        machine = machine.model_copy(update={"physics": (softens,)})
        with pytest.raises(InputError, match="too low to bear the load's torque"):
            simulate(machine, MOTION.demand(TIME), TIME)
