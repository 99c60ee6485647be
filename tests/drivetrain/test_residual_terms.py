"""Learned curves and the terms that the bench does not conceal: the balance of momentum, written here anew.

Of motor and load together the coupling's torque cancels: J_r ω_m + J_l ω_l grows by all outer torques' integral.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from schwung.drivetrain import load_machine, write_machine
from schwung.drivetrain.hysteresis import yielded
from schwung.drivetrain.machine import Load, Machine, paper_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.residual import Residual, residuals_of
from schwung.drivetrain.simulation import Simulated, simulate
from schwung.errors import InputError
from schwung.motion import Array, Motion

RATE, SHARE, INERTIA = 8000.0, 0.5, 0.1
#: Beginning and end of a straight line as a table, and a bend that a cubic between points has to keep.
ANGLES, SPEEDS = np.linspace(0.0, 3.0, 13), np.linspace(0.0, 40.0, 21)
ROWS = np.stack([ANGLES, 2.0 + np.sin(ANGLES), -3.0 - np.cos(ANGLES)], 1).tolist()
FAST = np.stack([SPEEDS, -0.2 * np.sqrt(SPEEDS + 1), 0.1 * SPEEDS], 1).tolist()
TIMES = np.linspace(0.0, 0.4, 81)
EVENTS = np.stack([TIMES, 4 * np.sin(9 * TIMES)], 1).tolist()

Acts = Callable[[Simulated, Array], Array]


def ahead(moved: Simulated, _time: Array) -> Array:
    """Which way the motor goes, −1…1."""
    return np.asarray(np.tanh(moved.speed_rad_s / 0.02))


def load_ahead(moved: Simulated, _time: Array) -> Array:
    """Which way the load goes, −1…1."""
    return np.asarray(np.tanh(moved.load_speed_rad_s / 0.02))


def either(forward: Array, backward: Array, way: Array) -> Array:
    """By direction."""
    return np.asarray(forward * np.maximum(way, 0) + backward * np.maximum(-way, 0))


def slid(angle: Array, distance: float) -> Array:
    """The share of friction that is there: what the way since each reversal has left of what was before it."""
    found, share, since, side, before = np.zeros(angle.size), 0.0, 0.0, 1.0, 0.0
    for i, way in enumerate(np.diff(angle), 1):
        if way * side < 0:
            side, since, before = -side, 0.0, share
        since += abs(way)
        share = side - (side - before) * np.exp(-since / distance)
        found[i] = share
    return found


def hot(load: Array, time_s: float, first: float) -> Array:
    """What its square, held from tick to tick, heats, in ten small steps of a tick."""
    heat, found = first, np.zeros_like(load)
    for i, one in enumerate(load):
        found[i] = heat
        for _ in range(10):
            heat += (one**2 - heat) / (10 * RATE * time_s)
    return found


def hung(angle: Array, speed: Array, time: Array) -> Array:
    """What a mass of 0.01 kg·m² takes of a load, by scipy."""

    def takes(now: float, state: Array) -> Array:
        turned, fast = np.interp(now, time, angle), np.interp(now, time, speed)
        return np.asarray((200.0 + 0.01 * 20 * fast**2) * (turned - state[0]) + 0.05 * (fast - state[1]))

    def rates(now: float, state: Array) -> Array:
        return np.array([state[1], takes(now, state) / 0.01])

    swung = solve_ivp(
        rates, (0.0, time[-1]), [angle[0], 0.0], t_eval=time, max_step=1e-3, rtol=1e-9, atol=1e-10
    ).y
    return np.array([takes(now, state) for now, state in zip(time, swung.T, strict=True)])


def on_angle(angle: Array, way: Array) -> Array:
    """What ROWS say."""
    return either(2 + np.sin(angle), -3 - np.cos(angle), way)


CASES: dict[str, tuple[dict[str, Any], Acts]] = {
    "friction over the angle": (
        {"name": "friction_over_angle", "table": [row[:2] for row in ROWS]},
        lambda s, t: -(2 + np.sin(s.position_rad)) * ahead(s, t),
    ),
    "drift of viscosity": (
        {"name": "viscous_drift", "change_nms": 0.4},
        lambda s, t: -0.4 * SHARE * s.speed_rad_s,
    ),
    "viscosity behind the coupling": (
        {"name": "viscous_friction", "load_coefficient_nms": 0.3},
        lambda s, t: -0.3 * s.load_speed_rad_s,
    ),
    "a fan": (
        {"name": "quadratic_drag", "load_coefficient_nms2": 0.02},
        lambda s, t: -0.02 * np.abs(s.load_speed_rad_s) * s.load_speed_rad_s,
    ),
    "drift of the offset": (
        {"name": "offset_drift", "change_nm": 6.0},
        lambda s, t: np.full(t.size, 6.0 * SHARE),
    ),
    "friction behind the coupling": (
        {"name": "load_side_friction", "torque_nm": 5.0},
        lambda s, t: -5.0 * load_ahead(s, t),
    ),
    "friction that is a spring before it slides": (
        {"name": "presliding_friction", "torque_nm": 6.0, "stiffness_nm_rad": 12.0},
        lambda s, _: -6.0 * slid(s.position_rad, 0.5),
    ),
    "direction-dependent load": (
        {"name": "direction_dependent_load", "table": ROWS},
        lambda s, t: on_angle(s.load_position_rad, load_ahead(s, t)),
    ),
    "spring at the high end": (
        {"name": "end_spring", "stiffness_nm_rad": 25.0, "position_rad": 1.8},
        lambda s, t: -25.0 * np.maximum(s.load_position_rad - 1.8, 0.0),
    ),
    "spring at the low end": (
        {"name": "end_spring", "stiffness_nm_rad": 25.0, "position_rad": 1.1, "side": -1},
        lambda s, t: 25.0 * np.maximum(1.1 - s.load_position_rad, 0.0),
    ),
    "torque constant that fades": (
        {"name": "torque_constant_drop", "share_at_peak": 0.1, "peak_nm": 100.0},
        lambda s, t: -0.1 * np.abs(s.torque_nm) * s.torque_nm / 100,
    ),
    "torque constant that fades late": (
        {"name": "torque_constant_drop", "share_at_peak": 0.1, "peak_nm": 100.0, "order": 2.0},
        lambda s, t: -0.1 * s.torque_nm**3 / 1e4,
    ),
    "torque constant that fades as the motor heats": (
        {"name": "torque_constant_fade", "share_at_peak": 0.8, "peak_nm": 100.0, "time_constant_s": 0.2,
         "start_heat": 0.1},
        lambda s, t: -0.8 * hot(s.torque_nm / 100, 0.2, 0.1) * s.torque_nm,
    ),
    "a mass that the speed stiffens": (
        {"name": "extra_compliance", "inertia_kgm2": 0.01, "stiffness_nm_rad": 200.0, "damping_nms": 0.05,
         "speed_share": 20.0},
        lambda s, t: -hung(s.load_position_rad, s.load_speed_rad_s, t),
    ),
    "ripple": (
        {"name": "torque_ripple", "order": 6.0, "share": 0.05, "phase_rad": 0.3},
        lambda s, t: s.torque_nm * 0.05 * np.sin(6 * s.position_rad + 0.3),
    ),
    "residual over position": (
        {"name": "residual", "coordinate": "position", "table": ROWS},
        lambda s, t: on_angle(s.position_rad, ahead(s, t)),
    ),
    "residual over speed": (
        {"name": "residual", "coordinate": "speed", "table": FAST},
        lambda s, t: either(
            -0.2 * np.sqrt(np.abs(s.speed_rad_s) + 1), 0.1 * np.abs(s.speed_rad_s), ahead(s, t)
        ),
    ),
    "residual over torque": (
        {"name": "residual", "coordinate": "torque", "table": [[0, 0, 0], [200, -20, 10]]},
        lambda s, t: either(-0.1 * np.abs(s.torque_nm), 0.05 * np.abs(s.torque_nm), ahead(s, t)),
    ),
    "residual over runs": (
        {"name": "residual", "coordinate": "run", "table": [[0, 0, 0], [1, -4, 6]]},
        lambda s, t: either(-2.0, 3.0, ahead(s, t)),
    ),
    "residual over time": (
        {"name": "residual", "coordinate": "time_in_motion", "table": EVENTS},
        lambda s, t: 4 * np.sin(9 * np.clip(t - 0.02, 0, 0.4)),
    ),
    "residual like a law": (
        {"name": "residual", "like": "viscous_friction", "coefficient_nms": 0.3},
        lambda s, t: -0.3 * s.speed_rad_s,
    ),
}  # fmt: skip


def machine_with(*terms: dict[str, Any], rigid: bool = False) -> Machine:
    """The paper's drive train with a level inertia."""
    paper = paper_machine()
    physics = tuple(PhysicsTerm.model_validate(term) for term in terms)
    return paper.model_copy(
        update={
            "coupling": None if rigid else paper.coupling,
            "load": Load(viscous_friction_nms=0.1, inertia_kgm2=INERTIA),
            "physics": physics,
        }
    )


def moved(machine: Machine) -> tuple[Simulated, Array]:
    """There and back, at every tick."""
    motion = Motion(distance_rad=2.5, duration_s=0.2, start_time_s=0.02, returns=True, dwell_s=0.02)
    time = np.arange(0.0, 0.45, 1 / RATE)
    return simulate(machine, motion.demand(time), time, start_rad=0.2, session_share=SHARE), time


def balance(
    made: Simulated, time: Array, acts: Array, inertia: Array | float = INERTIA, rotor: float = 0.012
) -> float:
    """The largest momentum (N·m·s) that is not accounted for, over the largest that there is."""
    outer = -0.2 * made.speed_rad_s - 0.1 * made.load_speed_rad_s + acts
    grown = np.concatenate([[0.0], np.cumsum((outer[1:] + outer[:-1]) / 2)]) / RATE
    driven = np.concatenate([[0.0], np.cumsum(made.torque_nm[:-1])]) / RATE
    momentum = rotor * made.speed_rad_s + inertia * made.load_speed_rad_s
    return float(np.max(np.abs(momentum - momentum[0] - grown - driven)) / np.max(np.abs(momentum)))


# without a coupling there is nothing to be behind
@pytest.mark.parametrize(
    ("name", "rigid"),
    [(n, r) for n in CASES for r in (False, True) if not (r and CASES[n][0]["name"] == "load_side_friction")],
)
def test_momentum_grows_by_what_the_term_says(name: str, rigid: bool) -> None:
    term, acts = CASES[name]
    made, time = moved(machine_with(term, rigid=rigid))
    acting = acts(made, time)
    assert balance(made, time, acting) < 3e-4
    assert balance(made, time, np.zeros(time.size)) > 1e-2


@pytest.mark.parametrize("rigid", [False, True])
def test_a_motor_inertia_is_in_place_of_the_believed_one(rigid: bool) -> None:
    made, time = moved(machine_with({"name": "motor_inertia", "inertia_kgm2": 0.02}, rigid=rigid))
    assert balance(made, time, np.zeros(time.size), rotor=0.02) < 3e-4
    assert balance(made, time, np.zeros(time.size)) > 1e-2


@pytest.mark.parametrize("rigid", [False, True])
def test_gear_loss_is_a_share_of_what_the_shaft_carries(rigid: bool) -> None:
    made, time = moved(machine_with({"name": "load_dependent_friction", "share": 0.1}, rigid=rigid))
    carried = INERTIA * np.gradient(made.load_speed_rad_s, time) + (
        0 if rigid else 0.1 * made.load_speed_rad_s
    )
    lost = -0.1 * np.abs(carried) * ahead(made, time)
    assert balance(made, time, lost) < 3e-3  # acceleration jumps with the held torque
    assert balance(made, time, 0 * lost) > 0.05


@pytest.mark.parametrize("rigid", [False, True])
def test_torque_over_acceleration_is_solved_for(rigid: bool) -> None:
    line = [[-3000.0, 90.0], [0.0, 0.0], [3000.0, -90.0]]  # −0.03 α: an inertia
    made, time = moved(
        machine_with({"name": "residual", "coordinate": "acceleration", "table": line}, rigid=rigid)
    )
    assert balance(made, time, np.zeros(time.size), INERTIA + 0.03) < 3e-4
    assert balance(made, time, np.zeros(time.size)) > 0.1


def test_stiffness_over_the_angle_drives_the_load() -> None:
    """What the load gains is what a coupling of that stiffness is wound up by."""
    made, _ = moved(
        machine_with({"name": "stiffness_over_angle", "order": 3.0, "share": 0.3, "phase_rad": 0.4})
    )
    coupling = paper_machine().coupling
    assert coupling is not None
    twist, turning = made.position_rad - made.load_position_rad, made.speed_rad_s - made.load_speed_rad_s
    gained = INERTIA * (made.load_speed_rad_s - made.load_speed_rad_s[0])

    def missing(share: float) -> float:
        stiffness = coupling.stiffness_nm_rad * (1 + share * np.sin(3 * made.position_rad + 0.4))
        pushed = stiffness * twist + coupling.damping_nms * turning - 0.1 * made.load_speed_rad_s
        passed = np.concatenate([[0.0], np.cumsum((pushed[1:] + pushed[:-1]) / 2)]) / RATE
        return float(np.max(np.abs(gained - passed)) / np.max(np.abs(gained)))

    assert missing(0.3) < 3e-3
    assert missing(0.0) > 3e-2


@pytest.mark.parametrize("gap", [0.0, 2e-3])
def test_a_residual_over_the_wind_up_is_what_the_coupling_passes_on_besides(gap: float) -> None:
    """What the load gains is what spring, damper and curve pass on; beyond the curve it stays as at its end."""
    wound = np.linspace(-2e-3, 2e-3, 41)
    bent = {
        "name": "residual",
        "coordinate": "wind_up",
        "table": np.stack([wound, 9 * np.sin(900 * wound)], 1).tolist(),
    }
    made, _ = moved(machine_with(bent, *([{"name": "backlash", "gap_rad": gap}] if gap else [])))
    coupling = paper_machine().coupling
    assert coupling is not None
    twist, turning = made.position_rad - made.load_position_rad, made.speed_rad_s - made.load_speed_rad_s
    touches = np.abs(twist) >= gap / 2
    beyond = twist - np.clip(twist, -gap / 2, gap / 2)
    gained = INERTIA * (made.load_speed_rad_s - made.load_speed_rad_s[0])
    pushed = touches * (coupling.stiffness_nm_rad * beyond + coupling.damping_nms * turning)
    pushed = np.where(pushed * twist > 0, pushed, 0.0) if gap else pushed

    def missing(share: float) -> float:
        besides = share * touches * 9 * np.sin(900 * np.clip(beyond, -2e-3, 2e-3))
        acts = pushed + besides - 0.1 * made.load_speed_rad_s
        passed = np.concatenate([[0.0], np.cumsum((acts[1:] + acts[:-1]) / 2)]) / RATE
        return float(np.max(np.abs(gained - passed)) / np.max(np.abs(gained)))

    assert np.max(np.abs(beyond)) > 1e-3
    assert missing(1.0) < (2e-2 if gap else 3e-3)
    assert missing(0.0) > 5e-2


@pytest.mark.parametrize("exponent", [1.0, 2.0, 6.0])
def test_a_coupling_with_hysteresis_holds_what_it_was_wound_up_by(exponent: float) -> None:
    """What the load gains is what spring, damper and that pass on, the law integrated here between samples by scipy."""
    yields_at, stiffness = 12.0, 1.5e4
    term = {
        "name": "coupling_hysteresis",
        "torque_nm": yields_at,
        "stiffness_nm_rad": stiffness,
        "exponent": exponent,
    }
    made, time = moved(machine_with(term))
    coupling = paper_machine().coupling
    assert coupling is not None
    twist, turning = made.position_rad - made.load_position_rad, made.speed_rad_s - made.load_speed_rad_s

    def rate(now: float, held: Array) -> Array:
        speed = np.interp(now, time, turning)
        loaded = held * speed > 0
        return np.asarray(stiffness * speed * (1 - loaded * np.abs(held / yields_at) ** exponent))

    held = solve_ivp(rate, (0.0, time[-1]), [0.0], t_eval=time, max_step=1 / RATE, rtol=1e-8).y[0]
    assert np.max(np.abs(held)) > 0.8 * yields_at

    def missing(acts: Array) -> float:
        passed = coupling.stiffness_nm_rad * twist + coupling.damping_nms * turning + acts
        passed -= 0.1 * made.load_speed_rad_s
        passed = np.concatenate([[0.0], np.cumsum((passed[1:] + passed[:-1]) / 2)]) / RATE
        gained = INERTIA * (made.load_speed_rad_s - made.load_speed_rad_s[0])
        return float(np.max(np.abs(gained - passed)) / np.max(np.abs(gained)))

    assert missing(held) < 3e-3
    assert missing(0 * held) > 3e-2
    assert yields_at * yielded(twist, yields_at / stiffness, exponent) == pytest.approx(
        held, abs=0.01 * yields_at
    )


@pytest.mark.parametrize("second", [0.0, 6e-4])
def test_a_transmission_that_is_off_drives_the_load_and_makes_no_power(second: float) -> None:
    """What the coupling gives the load, and what its ratio makes of that on the motor; `second`: of twice the order."""
    term = {
        "name": "kinematic_error", "order": 6.0, "amplitude_rad": 2e-3, "phase_rad": 0.4,
        "second_amplitude_rad": second, "second_phase_rad": 1.3,
    }  # fmt: skip
    made, _ = moved(machine_with(term))
    coupling = paper_machine().coupling
    assert coupling is not None
    angle, speed, load_speed = made.position_rad, made.speed_rad_s, made.load_speed_rad_s

    def summed(acts: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum((acts[1:] + acts[:-1]) / 2)]) / RATE

    def missing(amplitude: float, felt: float) -> tuple[float, float]:
        twist = angle + amplitude * np.sin(6 * angle + 0.4) - made.load_position_rad
        twist += second * np.sin(12 * angle + 1.3)
        ratio = 1 + amplitude * 6 * np.cos(6 * angle + 0.4) + second * 12 * np.cos(12 * angle + 1.3)
        shaft = coupling.stiffness_nm_rad * twist + coupling.damping_nms * (ratio * speed - load_speed)
        load = INERTIA * (load_speed - load_speed[0]) - summed(shaft - 0.1 * load_speed)
        outer = np.concatenate([[0.0], np.cumsum(made.torque_nm[:-1])]) / RATE
        motor = 0.012 * (speed - speed[0]) - outer + summed((1 + felt * (ratio - 1)) * shaft + 0.2 * speed)
        most = INERTIA * np.max(np.abs(load_speed))
        return float(np.max(np.abs(load)) / most), float(np.max(np.abs(motor)) / most)

    assert max(missing(2e-3, 1.0)) < 3e-3
    assert missing(0.0, 1.0)[0] > 3e-2
    assert missing(2e-3, 0.0)[1] > 6e-3


def test_a_transmission_that_is_off_rests_unwound_where_nothing_pulls() -> None:
    made, _ = moved(
        machine_with({"name": "kinematic_error", "order": 6.0, "amplitude_rad": 0.05, "phase_rad": 0.4})
    )
    angle = made.position_rad[0]
    assert angle == pytest.approx(0.2)
    assert made.load_position_rad[0] == pytest.approx(angle + 0.05 * np.sin(6 * angle + 0.4), abs=1e-12)
    assert made.torque_nm[:100] == pytest.approx(0.0, abs=1e-9)


def test_an_encoders_harmonic_is_read_and_so_shakes_the_machine() -> None:
    """A rigid machine's load is where the motor truly is: it obeys Newton, and the drive obeys what it reads."""
    term = {"name": "encoder_harmonic", "order": 9.0, "amplitude_rad": 2e-3, "phase_rad": 0.4}
    once = {"name": "encoder_eccentricity", "amplitude_rad": 0.01, "phase_rad": 1.0}
    made, time = moved(machine_with(term, once, rigid=True))
    true, speed = made.load_position_rad, made.load_speed_rad_s
    read = true + 2e-3 * np.sin(9 * true + 0.4) + 0.01 * np.sin(true + 1.0)
    assert made.position_rad == pytest.approx(read, abs=1e-12)
    faster = 0.018 * np.cos(9 * true + 0.4) + 0.01 * np.cos(true + 1.0)
    assert made.speed_rad_s == pytest.approx(speed * (1 + faster), abs=1e-10)
    assert balance(replace(made, speed_rad_s=speed), time, np.zeros(time.size)) < 3e-4
    assert balance(made, time, np.zeros(time.size)) > 1e-3
    control = paper_machine().required_control()
    error = control.position_gain_per_s * made.following_error_rad - made.speed_rad_s
    before = np.concatenate([[0.0], np.cumsum(error)[:-1]]) / RATE / control.speed_integral_time_s
    assert made.torque_nm == pytest.approx(control.speed_gain_nms * (error + before), abs=1e-6)
    quiet, _ = moved(machine_with(once, rigid=True))
    assert np.std(made.torque_nm - quiet.torque_nm) > 1.0


def test_a_profile_adds_to_the_inertia() -> None:
    angle = np.linspace(-0.5, 3.5, 81)
    table = np.stack([angle, 0.05 * np.sin(2 * angle)], 1).tolist()
    made, time = moved(machine_with({"name": "inertia_profile", "table": table}))
    turned, speed = made.load_position_rad, made.load_speed_rad_s
    half = 0.5 * 0.1 * np.cos(2 * turned) * speed**2
    assert balance(made, time, half, INERTIA + 0.05 * np.sin(2 * turned)) < 3e-4


def test_a_filter_of_what_is_reported_changes_nothing_else() -> None:
    plain, _ = moved(machine_with())
    made, _ = moved(machine_with({"name": "torque_filter", "time_constant_s": 1e-3}))
    assert made.position_rad == pytest.approx(plain.position_rad, abs=1e-9)
    decay = np.exp(-1 / 8)
    wanted = (1 - decay) * plain.torque_nm[1000] + decay * made.torque_nm[1000]
    assert made.torque_nm[1001] == pytest.approx(wanted)


def test_two_over_one_coordinate_add_up_and_survive_writing(tmp_path: Any) -> None:
    one, two = CASES["residual over position"][0], CASES["friction over the angle"][0]
    write_machine(machine_with(one, two), tmp_path / "machine.toml")
    table = residuals_of(load_machine(tmp_path / "machine.toml").physics)["position"]
    assert isinstance(table, Residual)
    assert table.at(np.array([0.5]), np.array([1.0])) == pytest.approx([0.0], abs=1e-9)
    assert table.at(np.array([0.5]), np.array([-1.0])) == pytest.approx(
        [2 + np.sin(0.5) - 3 - np.cos(0.5)], abs=1e-3
    )


@pytest.mark.parametrize(
    ("term", "sentence"),
    [
        (
            {"coordinate": "colour", "table": ROWS},
            "coordinate is 'colour'. It has to be one of position, speed",
        ),
        ({"table": ROWS}, "coordinate is None"),
        ({"coordinate": "speed", "table": [[0, 1, 2]]}, "not made of rows of numbers"),
        ({"coordinate": "speed", "table": [[0, 1, 2], [1, 2]]}, "not made of rows of numbers"),
        ({"coordinate": "speed", "table": [[1, 1, 2], [0, 2, 3]]}, "do not increase"),
        ({"coordinate": "acceleration", "table": ROWS}, "two directions over acceleration"),
        ({"like": "dahl"}, "not a known physics term"),
        ({"like": "coulomb_friction"}, "torque_nm is None"),
    ],
)
def test_what_is_no_residual_is_told(term: dict[str, Any], sentence: str, tmp_path: Any) -> None:
    good = machine_with({"name": "residual", "coordinate": "speed", "table": FAST})
    write_machine(good, tmp_path / "machine.toml")
    bad = PhysicsTerm.model_validate({"name": "residual", **term})
    write_machine(good.model_copy(update={"physics": (bad,)}), tmp_path / "machine.toml")
    with pytest.raises(InputError, match=sentence):
        load_machine(tmp_path / "machine.toml")
