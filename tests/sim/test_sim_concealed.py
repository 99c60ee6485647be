"""What `--conceal` switches on: its syntax, and each effect against a fact of mechanics, in its own coordinate."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from schwung_sim.drives.axis import ServoAxis
from schwung_sim.errors import BenchError
from schwung_sim.plants import EFFECTS, TICK_S, Profile, TwoMassMachine, TwoMassPlant, parse_conceal

Array = NDArray[np.float64]
INERTIA, ROTOR = 0.1, 0.012
TOTAL = INERTIA + ROTOR


def plant(conceal: str = "", damping: float = 8.62, seed: int = 0) -> TwoMassPlant:
    """Constant inertia, no friction but what is concealed: mechanics by hand applies."""
    machine = TwoMassMachine(rotor_viscous_nms=0.0, load_viscous_nms=0.0, damping_nms=damping)
    return TwoMassPlant(machine, Profile.constant(INERTIA), parse_conceal(conceal), seed)


def spin(p: TwoMassPlant, speed: float) -> TwoMassPlant:
    """Both masses at one speed."""
    p.state["motor_rad_s"] = p.state["load_rad_s"] = speed
    return p


def push(p: TwoMassPlant, torque_nm: float, seconds: float) -> Array:
    """Rows of motor angle, motor speed, load angle, load speed after each tick."""
    rows = []
    for _ in range(round(seconds / TICK_S)):
        p.step(torque_nm)
        s = p.state[0]
        rows.append((s["motor_rad"], s["motor_rad_s"], s["load_rad"], s["load_rad_s"]))
    return np.array(rows)


def momentum(rows: Array) -> Array:
    """Angular momentum of both masses over time (N·m·s)."""
    return np.asarray(ROTOR * rows[:, 1] + INERTIA * rows[:, 3])


# Syntax


def test_every_name_and_key_of_the_file_contract_exists() -> None:
    contract = {
        "coulomb_friction": "torque_nm",
        "stribeck_friction": "coulomb_torque_nm breakaway_torque_nm stribeck_speed_rad_s",
        "asymmetric_friction": "torque_positive_nm torque_negative_nm",
        "viscous_friction": "coefficient_nms",
        "quadratic_drag": "coefficient_nms2",
        "local_friction": "torque_nm centre_rad width_rad",
        "friction_drift": "change_nm",
        "load_torque": "table amplitude_nm phase_rad",
        "torque_offset": "torque_nm",
        "load_event": "time_s duration_s peak_nm",
        "periodic_disturbance": "frequency_hz amplitude_nm",
        "cogging": "order amplitude_nm phase_rad",
        "torque_constant": "gain",
        "torque_lag": "time_constant_s",
        "torque_saturation": "limit_nm",
        "measurement_delay": "delay_s",
        "encoder_eccentricity": "amplitude_rad",
        "backlash": "gap_rad",
        "coupling_stiffness": "stiffness_nm_rad",
        "coupling_damping": "damping_nms",
        "nonlinear_stiffness": "cubic_nm_rad3",
        "extra_compliance": "inertia_kgm2 stiffness_nm_rad damping_nms",
        "load_inertia": "delta_kgm2 scale",
        "inertia_profile_shift": "shift_rad",
    }
    assert set(contract) == set(EFFECTS)
    for name, keys in contract.items():
        assert set(keys.split()) <= set(EFFECTS[name].key_names), name


def test_syntax() -> None:
    text = (
        "coulomb_friction, cogging=48 ,stribeck_friction=2:breakaway_torque_nm=5,load_torque:table=0/1~2/-3"
    )
    assert parse_conceal(text).effects == {
        "coulomb_friction": {},
        "cogging": {"order": 48.0},
        "stribeck_friction": {"coulomb_torque_nm": 2.0, "breakaway_torque_nm": 5.0},
        "load_torque": {"table": ((0.0, 1.0), (2.0, -3.0))},
    }
    assert not parse_conceal("").effects


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("colomb_friction=3", 'called "colomb_friction".*coulomb_friction, stribeck_friction'),
        ("cogging:orde=3", 'no key "orde".*order, amplitude_nm, phase_rad'),
        ("cogging=many", 'order is "many".*a number'),
        ("cogging:order", 'order is "".*a number'),
        ("backlash=-0.1", "gap_rad is -0.1.*not negative"),
        ("torque_constant=0", "gain is 0.*positive"),
        ("torque_offset=nan", "torque_nm is nan.*finite"),
        ("cogging,cogging", "given twice"),
        ("load_torque:table=0/1", "angle/torque"),
        ("load_torque:table=0/1~0/2", "do not increase"),
        ("load_torque:table=0/1~inf/2", "angle/torque"),
    ],
)
def test_wrong_use_says_what_exists(text: str, complaint: str) -> None:
    with pytest.raises(BenchError, match=complaint):
        parse_conceal(text)


@pytest.mark.parametrize("name", EFFECTS)
def test_bare_name_makes_a_difference(name: str) -> None:
    def history(conceal: str) -> Array:
        axis = ServoAxis(plant(conceal))
        axis.energise(True)
        rows = []
        for stroke in (1, -1):
            axis.start_move(1.5 + 1.5 * stroke, 30.0, 600.0, 600.0)
            for _ in range(140):
                axis.advance(0.002)
                rows.append((axis.position_rad, axis.speed_rad_s, axis.torque_nm))
        return np.array(rows)

    if name == "inertia_profile_shift":
        shifted = TwoMassPlant(concealed=parse_conceal(name)).true_inertia(np.array([1.0]))
        assert shifted == pytest.approx(TwoMassPlant().true_inertia(np.array([1.1])))
        return
    assert np.max(np.abs(history(name) - history("")), axis=0).max() > 1e-3


# Friction of the motor shaft


def test_coulomb_friction_holds_then_slides() -> None:
    p = plant("coulomb_friction=3")
    assert np.all(push(p, 2.9, 0.1)[:, :2] == 0)  # it does not even creep
    rows = push(p, 5.0, 0.1)
    assert momentum(rows)[-1] == pytest.approx((5 - 3) * 0.1, rel=1e-3)


def test_coulomb_friction_stops_a_coasting_axis_for_good() -> None:
    rows = push(spin(plant("coulomb_friction=3"), 2.0), 0.0, 0.2)
    stop = np.argmax(rows[:, 1] == 0) * TICK_S
    assert stop == pytest.approx(TOTAL * 2.0 / 3, rel=0.05)
    assert np.all(np.abs(rows[-100:, 1]) < 1e-6)


def test_stribeck_friction_breaks_away_high_and_slides_low() -> None:
    text = "stribeck_friction:coulomb_torque_nm=3:breakaway_torque_nm=5:stribeck_speed_rad_s=1"
    assert np.all(push(plant(text), 4.9, 0.05)[:, 1] == 0)
    assert push(plant(text), 5.1, 0.05)[-1, 1] > 0
    rows = push(spin(plant(text), 20.0), 0.0, 0.05)
    assert TOTAL * 20 - momentum(rows)[-1] == pytest.approx(3 * 0.05, rel=1e-4)


@pytest.mark.parametrize(("speed", "level"), [(10.0, 4.0), (-10.0, 2.0)])
def test_asymmetric_friction_brakes_by_direction(speed: float, level: float) -> None:
    text = "asymmetric_friction:torque_positive_nm=4:torque_negative_nm=2"
    rows = push(spin(plant(text), speed), 0.0, 0.05)
    assert abs(TOTAL * speed) - abs(momentum(rows)[-1]) == pytest.approx(level * 0.05, rel=1e-4)


def test_viscous_friction_decays_exponentially() -> None:
    rows = push(spin(plant("viscous_friction=0.5"), 10.0), 0.0, 0.4)
    rate = -np.polyfit(np.arange(1600), np.log(rows[1600:, 1]), 1)[0] / TICK_S
    assert rate == pytest.approx(0.5 / TOTAL, rel=1e-2)


def test_quadratic_drag_lets_one_over_speed_grow_evenly() -> None:
    rows = push(spin(plant("quadratic_drag=0.02"), 30.0), 0.0, 0.4)
    slope = np.polyfit(np.arange(1600), 1 / rows[1600:, 1], 1)[0] / TICK_S
    assert slope == pytest.approx(0.02 / TOTAL, rel=1e-3)


def test_local_friction_takes_its_work_within_its_width_each_turn() -> None:
    text = "local_friction:torque_nm=6:centre_rad=1:width_rad=0.4"
    rows = push(spin(plant(text), 20.0), 0.0, 0.6)
    energy = TOTAL * rows[:, 1] ** 2 / 2
    for turn in (0, 1):
        before, after = (np.searchsorted(rows[:, 0], turn * 2 * np.pi + x) for x in (0.75, 1.6))
        assert energy[before] - energy[after] == pytest.approx(6 * 0.4 / 2, rel=0.02)
    assert energy[np.searchsorted(rows[:, 0], 0.79)] == pytest.approx(TOTAL * 200, rel=1e-6)


def test_friction_drift_grows_motion_by_motion() -> None:
    p = plant("coulomb_friction=2,friction_drift=3:motions=4")
    lost = []
    for _ in range(6):
        p.begin_motion()
        rows = push(spin(p, 10.0), 0.0, 0.01)
        lost.append((TOTAL * 10 - momentum(rows)[-1]) / 0.01)
    np.testing.assert_allclose(lost, [2, 3, 4, 5, 5, 5], rtol=1e-2)


# Load torque and disturbances


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("load_torque:amplitude_nm=5:phase_rad=0.5", 5 * np.sin(0.8 + 0.5)),
        ("load_torque:table=0/0~0.8/-4~2/1", -4.0),
        ("torque_offset=2", 2.0),
        ("cogging:order=6:amplitude_nm=3:phase_rad=0.2", 3 * np.sin(6 * 0.8 + 0.2)),
    ],
)
def test_torque_at_an_angle(text: str, expected: float) -> None:
    p = plant(text)
    p.state["motor_rad"] = p.state["load_rad"] = 0.8
    rows = push(p, 0.0, 0.004)
    assert momentum(rows)[-1] == pytest.approx(expected * 0.004, rel=0.01)


def test_load_torque_acts_on_the_load_and_offset_on_the_motor() -> None:
    for text, moved, other in (("load_torque:table=-1/5~1/5", 3, 1), ("torque_offset=5", 1, 3)):
        rows = push(plant(text), 0.0, TICK_S)
        assert abs(rows[0, moved]) > 5 * abs(rows[0, other])


def test_load_event_is_one_pulse_at_its_time_in_each_motion() -> None:
    p = plant("load_event:time_s=0.05:duration_s=0.02:peak_nm=30")
    assert np.all(push(p, 0.0, 0.2) == 0)  # nothing before a motion
    for motion in (1, 2):
        p.begin_motion()
        p.state["motor_rad_s"] = p.state["load_rad_s"] = 0.0
        p.state["load_rad"] = p.state["motor_rad"]
        rows = push(p, 0.0, 0.1)
        assert np.all(rows[:399, 1] == 0), motion
        assert momentum(rows)[-1] == pytest.approx(30 * 0.02 / 2, rel=1e-4)


def test_periodic_disturbance_keeps_its_frequency_at_any_speed_and_its_phase_by_seed() -> None:
    for speed in (0.0, 15.0):
        rows = push(spin(plant("periodic_disturbance=40:amplitude_nm=2", seed=3), speed), 0.0, 0.5)
        ripple = momentum(rows)
        ripple -= ripple.mean()
        spectrum = np.abs(np.fft.rfft(ripple)) / len(ripple) * 2
        assert np.argmax(spectrum) / 0.5 == pytest.approx(40.0)
        assert spectrum.max() == pytest.approx(2 / (2 * np.pi * 40), rel=1e-2)
    one, same, other = (push(plant("periodic_disturbance", seed=n), 0.0, 0.01) for n in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.allclose(one, other)


def test_cogging_is_periodic_in_angle() -> None:
    """Energy lost and won follows (A/n) cos(n θ + φ), at whatever speed."""
    order, amplitude, phase = 12, 3.0, 0.7
    for speed in (5.0, 9.0):
        text = f"cogging:order={order}:amplitude_nm={amplitude}:phase_rad={phase}"
        p = spin(plant(text, damping=0.0), speed)
        p.parameters["stiffness_nm_rad"] = 2e5  # nearly rigid
        rows = push(p, 0.0, 0.4)
        twist = rows[:, 0] - rows[:, 2]
        energy = (ROTOR * rows[:, 1] ** 2 + INERTIA * rows[:, 3] ** 2 + 2e5 * twist**2) / 2
        potential = amplitude / order * np.cos(order * rows[:, 0] + phase)
        np.testing.assert_allclose(energy + potential, (energy + potential)[0], atol=1e-3)
        assert np.ptp(potential) > 0.4


# The actuator


def test_torque_constant_is_true_over_reported() -> None:
    assert momentum(push(plant("torque_constant=0.9"), 10.0, 0.05))[-1] == pytest.approx(0.45, rel=1e-9)


def test_torque_lag_owes_torque_times_time_constant() -> None:
    for lag in (0.5e-3, 1e-6):
        rows = push(plant(f"torque_lag={lag}"), 10.0, 0.05)
        assert momentum(rows)[-1] == pytest.approx(10 * (0.05 - lag), rel=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_torque_saturation_clips_both_ways(sign: int) -> None:
    rows = push(plant("torque_saturation=30"), sign * 100.0, 0.02)
    assert momentum(rows)[-1] == pytest.approx(sign * 30 * 0.02, rel=1e-9)


# The coupling and what hangs on it


def settled_twist(text: str, torque: float) -> float:
    """Twist under steady acceleration: the coupling passes torque·J_l/(J_r + J_l)."""
    rows = push(plant(text, damping=30.0), torque, 0.2)
    return float(rows[-1, 0] - rows[-1, 2])


PASSED = 50.0 * INERTIA / TOTAL


def test_coupling_stiffness() -> None:
    assert settled_twist("", 50.0) == pytest.approx(PASSED / 24963, rel=1e-6)
    assert settled_twist("coupling_stiffness=12000", 50.0) == pytest.approx(PASSED / 12000, rel=1e-6)


def test_nonlinear_stiffness_adds_a_cube() -> None:
    twist = settled_twist("nonlinear_stiffness=5e9", 50.0)
    assert 24963 * twist + 5e9 * twist**3 == pytest.approx(PASSED, rel=1e-6)
    assert 5e9 * twist**3 > 0.2 * PASSED


def test_backlash_widens_the_twist_by_half_the_gap_each_way() -> None:
    for sign in (1, -1):
        twist = settled_twist("backlash=0.004", sign * 50.0)
        assert twist == pytest.approx(sign * (0.002 + PASSED / 24963), rel=1e-4)


def test_within_the_backlash_the_load_knows_nothing() -> None:
    p = plant("backlash=0.004")
    rows = push(p, 1.0, 0.009)
    free = rows[:, 0] < 0.002
    assert np.all(rows[free, 2:] == 0)
    assert np.any(~free)
    assert rows[free, 1][-1] == pytest.approx(1.0 / ROTOR * np.sum(free) * TICK_S, rel=1e-6)


def test_coupling_damping_sets_the_decay() -> None:
    for damping in (4.0, 8.0):
        p = plant(f"coupling_damping={damping}")
        p.state["motor_rad_s"], p.state["load_rad_s"] = 1.0, -ROTOR / INERTIA
        rows = push(p, 0.0, 0.03)
        twist, rate = rows[:, 0] - rows[:, 2], rows[:, 1] - rows[:, 3]
        decay = damping * (1 / ROTOR + 1 / INERTIA) / 2
        stored = 24963 * twist**2 + rate**2 / (1 / ROTOR + 1 / INERTIA) + damping * twist * rate
        measured = -np.polyfit(np.arange(240) * TICK_S, np.log(stored), 1)[0] / 2
        assert measured == pytest.approx(decay, rel=0.02)


def test_extra_compliance_adds_its_inertia_on_its_spring() -> None:
    text = "extra_compliance:inertia_kgm2=0.02:stiffness_nm_rad=3000:damping_nms=3"
    p = plant(text)
    rows = push(p, 10.0, 0.1)
    third = 0.02 * p.state["third_rad_s"][0]
    assert momentum(rows)[-1] + third == pytest.approx(10 * 0.1, rel=1e-9)
    twist = p.state["load_rad"][0] - p.state["third_rad"][0]
    assert twist == pytest.approx(10 * 0.02 / (TOTAL + 0.02) / 3000, rel=1e-3)


def test_load_inertia_delta_and_scale() -> None:
    angle = np.array([1.0])
    for text, expected in (
        ("load_inertia:delta_kgm2=0.02", 0.12),
        ("load_inertia:scale=1.2", 0.12),
        ("load_inertia:delta_kgm2=-0.01:scale=1.2", 0.11),
    ):
        p = plant(text)
        assert p.true_inertia(angle) == pytest.approx([expected])
        rows = push(p, 10.0, 0.1)
        assert ROTOR * rows[-1, 1] + expected * rows[-1, 3] == pytest.approx(10 * 0.1, rel=1e-9)


def test_inertia_profile_shift_moves_what_the_load_feels() -> None:
    shifted = TwoMassPlant(concealed=parse_conceal("inertia_profile_shift=0.3"))
    plain = TwoMassPlant()
    plain.state["motor_rad"] = plain.state["load_rad"] = 0.3
    a, b = push(shifted, 40.0, 0.1), push(plain, 40.0, 0.1)
    np.testing.assert_allclose(a[:, 1], b[:, 1], rtol=1e-9)
    np.testing.assert_allclose(a[:, 0] + 0.3, b[:, 0], rtol=1e-9)


# Measurement


def moved_axis(conceal: str) -> tuple[ServoAxis, Array]:
    """An axis on the move: rows of angle, speed and torque as reported and the true angle, each control tick."""
    p = plant(conceal)
    axis = ServoAxis(p)
    axis.energise(True)
    axis.start_move(3.0, 18.0, 200.0, 200.0)
    rows = []
    for _ in range(1600):
        axis.advance(TICK_S)
        rows.append((axis.position_rad, axis.speed_rad_s, axis.torque_nm, p.motor_rad))
    return axis, np.array(rows)


@pytest.mark.parametrize("ticks", [4, 2.5, 0])
def test_measurement_delay_shifts_the_reported_speed_only(ticks: float) -> None:
    plain, late = moved_axis("")[1], moved_axis(f"measurement_delay={ticks * TICK_S}")[1]
    at = np.arange(1600.0)
    expected = np.interp(at - ticks, at, plain[:, 1])
    np.testing.assert_allclose(late[10:, 1], expected[10:], atol=1e-9)
    np.testing.assert_array_equal(late[:, [0, 2, 3]], plain[:, [0, 2, 3]])


def test_encoder_eccentricity_bends_the_reported_angle_once_per_turn() -> None:
    axis, rows = moved_axis("encoder_eccentricity=0.002")
    count = 2 * np.pi / axis.settings.encoder_counts
    np.testing.assert_allclose(rows[:, 0] - rows[:, 3], 0.002 * np.sin(rows[:, 3]), atol=count)


def test_the_spec_page_and_the_catalogue_tell_the_same_story() -> None:
    """Every example in the module's own text parses."""
    text = Path(parse_conceal.__code__.co_filename).read_text(encoding="utf-8")
    examples = re.findall(r"^    ((?:coulomb|stribeck|load)_\S+)", text.split('"""')[1], re.MULTILINE)
    assert len(examples) == 5
    for example in examples:
        assert parse_conceal(example).effects
