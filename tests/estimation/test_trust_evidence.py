"""What a session says against its own estimate: wrong numbers in the machine file, play, and what cannot be seen."""

from dataclasses import replace

import numpy as np
import pytest
from estimation_plant import ROTOR, STIFFNESS, Hidden, crank, pair, phases, session_of

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Coupling, Motor
from schwung.estimation import estimate
from schwung.estimation.evidence import Evidence, motion_scale
from schwung.estimation.fit import Nuisance
from schwung.motion import Excitation, Motion
from schwung.session import Run
from schwung_sim.drives.axis import ServoAxis
from schwung_sim.plants import TICK_S, TwoMassPlant, parse_conceal
from schwung_sim.recording import Noise, play

ANGLE = np.linspace(0.0, np.pi, 64)


@pytest.fixture(scope="module")
def four():
    return phases(0.25, rate=2000.0)


@pytest.fixture(scope="module")
def true_table():
    return InertiaTable(ANGLE, crank(ANGLE))


def relative_rmse(found):
    off = found.table.inertia_kgm2 - crank(found.table.position_rad)
    return float(np.sqrt(np.mean(off**2)) / np.mean(crank(ANGLE)))


def stiffer(machine, factor):
    return machine.model_copy(
        update={"coupling": Coupling(stiffness_nm_rad=factor * STIFFNESS, damping_nms=8.62)}
    )


def test_the_true_table_carries_the_motion(four, fast, machine, true_table):
    for runs in (four.excited, fast.references):
        found = motion_scale(runs, machine, true_table, 50.0, rotary=True)
        assert found.value == pytest.approx(1.0, abs=0.005)
        assert found.std < 0.005


def test_a_table_ten_percent_up_is_contradicted_by_as_much(fast, machine, true_table):
    """s weighs rotor and load together: (J_r + J)/(J_r + 1.1 J) of the mean."""
    heavy = InertiaTable(ANGLE, 1.1 * true_table.inertia_kgm2)
    mean = float(np.mean(crank(ANGLE)))
    found = motion_scale(fast.references, machine, heavy, 50.0, rotary=True)
    assert found.value == pytest.approx((ROTOR + mean) / (ROTOR + 1.1 * mean), abs=0.01)


def test_friction_and_weight_that_nobody_mentioned_do_not_shift_the_scale(machine, true_table):
    session = pair(0.25, rate=1000.0, hidden=Hidden(coulomb=4.0, viscous=0.3, gravity=6.0))
    found = motion_scale(session.references, machine, true_table, 50.0, rotary=True)
    assert abs(found.value - 1) < 0.01


def test_a_wrong_stiffness_is_noticed_and_the_robust_method_taken(four, machine):
    wrong = stiffer(machine, 0.7)
    named = estimate(four, wrong, "multiphase")
    assert relative_rmse(named) > 0.05
    assert named.trust.verdict != "good"
    assert 0.5 < named.trust.predicted_error / relative_rmse(named) < 2
    assert any("check stiffness" in reason for reason in named.trust.reasons)
    chosen = estimate(four, wrong)
    assert chosen.method == "trajectory"
    assert relative_rmse(chosen) < 0.01
    assert chosen.trust.verdict == "good"
    assert any("Method multiphase is in doubt" in note and "trajectory" in note for note in chosen.notes)
    assert any("stiffness comes out" in reason for reason in chosen.trust.reasons)


def test_a_right_file_is_good_with_either_method_and_needs_no_other(four, machine, estimated):
    found = estimated(four, machine)
    assert (found.method, found.trust.verdict) == ("multiphase", "good")
    assert found.trust.predicted_error < 0.02
    assert not any("in doubt" in note for note in found.notes)


def test_a_heavy_rotor_in_the_file_shows_in_the_motion(four, machine, true_table):
    motor = Motor(inertia_kgm2=3 * ROTOR, viscous_friction_nms=0.2, peak_torque_nm=233.0)
    wrong = machine.model_copy(update={"motor": motor})
    found = estimate(four, wrong, "multiphase")
    assert relative_rmse(found) > 0.05
    assert found.trust.verdict != "good"


def test_a_factor_on_all_torques_is_not_seen_by_a_rigid_machine(constant_rigid, rigid):
    """Torque constant off by a tenth: T and J_r + J_l both scale, and every balance holds. Said in the docs."""
    off = replace(
        constant_rigid, runs=tuple(replace(run, torque_nm=1.1 * run.torque_nm) for run in constant_rigid.runs)
    )
    found = estimate(off, rigid, "denoised")
    assert np.mean(found.table.inertia_kgm2) > 1.08 * 0.1
    assert found.trust.verdict == "good"


def test_parts_add_up_by_squares_and_chance_does_not_count():
    unmoved = Nuisance(1.0, 0.01)
    sure = Evidence(band=0.03, difference=0.04, unexplained=0.0, scale=unmoved, missed=None, spread=0.03)
    assert sure.predicted == pytest.approx(0.04), "the windows' band knows of a part of the difference"
    assert Evidence(0.03, None, None, None, None, Nuisance(0.01, 0.01)).predicted == 0.03
    assert Evidence(None, None, None, Nuisance(1.02, 0.02), None).contradiction == 0.0
    assert Evidence(None, None, None, Nuisance(0.95, 0.02), None).contradiction == pytest.approx(0.02)
    assert Evidence(None, None, None, Nuisance(1.25, 0.15), None).contradiction == 0.0, "too vague to accuse"
    assert Evidence(None, None, None, None, missed=0.2).doubts == {"missed": pytest.approx(0.05)}


@pytest.mark.parametrize(("off", "least", "most"), [(0.05, 0.02, 0.05), (0.5, 0.0, 1e-6)])
def test_another_stiffness_may_be_a_torque_constant_as_far_as_one_may_be_off(off, least, most):
    """5 % are as likely a torque constant's, and then the inertia's, too; half as much again is a stiffness's."""
    assert least <= Evidence(None, None, None, None, None, Nuisance(off, 1e-3)).left_out < most


def test_the_expected_error_goes_into_the_json(four, machine):
    found = estimate(four, machine, "multiphase")
    assert found.to_json()["trust"]["predicted_error"] == found.trust.predicted_error > 0


def test_friction_that_shifts_the_path_but_not_the_inertia_is_no_reason_to_worry(machine):
    """The paper's position check alone would condemn it."""
    session = pair(0.25, rate=1000.0, hidden=Hidden(coulomb=5.0))
    found = estimate(session, machine, "denoised")
    assert relative_rmse(found) < 0.03
    assert found.trust.position_dc_rad > 0.25 * found.trust.position_amplitude_rad
    assert found.trust.verdict == "good"


def on_the_bench(conceal):
    """Four phases of the Table 1 machine with play or without, at 2 kHz, on the virtual axis."""
    motion = Motion(distance_rad=np.pi, duration_s=0.25, start_time_s=0.15, dwell_s=0.1)
    instants = motion.time(1 / TICK_S)
    runs = []
    for number in range(4):
        sine = Excitation(
            frequency_hz=50.0,
            amplitude_nm=46.6,
            phase_rad=number * np.pi / 2,
            ramp_s=0.04,
            end_s=motion.total_s,
        )
        axis = ServoAxis(TwoMassPlant(concealed=parse_conceal(conceal)))
        demand, added = motion.demand(instants).position_rad, sine.torque(instants)
        made = play(axis, demand, added, 4, Noise(), number)
        signals = {
            n: getattr(made, n)
            for n in ("time_s", "position_rad", "speed_rad_s", "torque_nm", "torque_added_nm")
        }
        runs.append(
            Run("excited", 0, 2000.0, **signals, motion=motion, excitation=sine, name=f"phase {number}")
        )
    return session_of(*runs)


@pytest.mark.parametrize(("gap", "verdicts"), [("1e-6", {"good"}), ("1e-3", {"doubtful", "unusable"})])
def test_play_in_the_coupling_is_told_from_its_absence(machine, gap, verdicts):
    """The same plant with a play of nothing and of half the wind-up that the injection makes."""
    found = estimate(on_the_bench(f"backlash={gap}"), machine, "multiphase")
    assert found.trust.verdict in verdicts
    assert (relative_rmse(found) < 0.02) == (verdicts == {"good"})


@pytest.mark.parametrize(("misses", "left_out", "doubts"), [(True, 0.02, {}), (False, 0.0, {"missed": 0.02})])
def test_what_a_fit_misses_beyond_its_noise_is_in_its_band(misses, left_out, doubts):
    """Play leaves a twelfth of the torque without an explanation, and its band held the truth at every second angle."""
    found = Evidence(0.005, None, None, None, 0.08, whole=True, misses=misses)
    assert found.left_out == pytest.approx(left_out)
    assert found.predicted == pytest.approx(float(np.hypot(0.005, left_out)))
    assert found.doubts == pytest.approx(doubts)
