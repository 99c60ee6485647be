"""The paper's checks, and the verdict that takes their place, on exact physics."""

from dataclasses import replace

import numpy as np
import pytest
from estimation_plant import pair, session_of

from schwung.drivetrain.inertia import InertiaTable, slider_crank_inertia
from schwung.drivetrain.machine import Load
from schwung.estimation import estimate
from schwung.estimation.trust import RELATIVE_MIV


def test_miv_crosses_the_papers_bound_between_250_and_200_ms(fast, faster, machine, estimated):
    """Fig. 14: MIV ascends above 0.05 at 200 ms. It judges where nothing sharper can: a run without reference."""
    good, less = (estimated(session, machine, "denoised").trust for session in (fast, faster))
    assert good.miv_kgm2 < 0.05 < less.miv_kgm2 < 0.08
    assert good.predicted_error < less.predicted_error
    alone = estimate(session_of(*faster.excited), machine, "former").trust
    assert alone.verdict != "good"
    assert any("within one period" in reason and "move more slowly" in reason for reason in alone.reasons)


def test_the_error_expected_is_the_error_made(fast, faster, machine, estimated):
    """Windows smear the curve: the session itself shows by how much, without the truth."""
    for session in (fast, faster):
        found = estimated(session, machine, "denoised")
        off = found.table.inertia_kgm2 - slider_crank_inertia(found.table.position_rad)
        relative = np.sqrt(np.mean(off**2)) / np.mean(found.table.inertia_kgm2)
        assert (
            0.5 < found.trust.predicted_error / relative < 2
        )  # one standard deviation: the table's own band


def test_relative_bounds_are_the_papers_on_its_own_machine():
    """0.05 and 0.08 kg·m² over a mean of 0.11."""
    mean = float(np.mean(slider_crank_inertia(np.linspace(0, np.pi, 2001))))
    np.testing.assert_allclose(np.array(RELATIVE_MIV) * mean, [0.05, 0.08], rtol=0.03)


def test_dpr_of_the_paper(slow, machine):
    """0.075 printed at 500 ms; 0.078 at J_l = 0.11."""
    angle = np.array([0.0, 3.0])
    believed = machine.model_copy(update={"load": Load(viscous_friction_nms=0.1,
                                  inertia_table=InertiaTable(angle, np.array([0.11, 0.11])))})  # fmt: skip
    assert estimate(slow, believed).trust.dpr == pytest.approx(0.078, abs=0.001)
    assert estimate(slow, believed, "former").trust.dpr == pytest.approx(0.078, abs=0.001)
    assert estimate(slow, machine.model_copy(update={"control": None})).trust.dpr is None


def test_former_method_is_judged_by_dpr(faster, machine):
    angle = np.linspace(0.0, np.pi, 50)
    table = InertiaTable(angle, slider_crank_inertia(angle))
    believed = machine.model_copy(update={"load": Load(viscous_friction_nms=0.1, inertia_table=table)})
    trust = estimate(faster, believed, "former").trust
    assert trust.dpr == pytest.approx(0.033, abs=0.001)
    assert any("3.3 % of the motion's speed (DPR), below the 5 %" in reason for reason in trust.reasons)
    assert not any("DPR" in reason for reason in estimate(faster, believed).trust.reasons)


def test_position_deviation_is_a_sine_with_little_else(fast, machine, estimated):
    """20 % of T_max against the inertia: T/(ω² (J_r + J_l)), lifted a little by the controller."""
    trust = estimated(fast, machine).trust
    assert trust.position_amplitude_rad == pytest.approx(46.6 / (314.16**2 * (0.012 + 0.067)), rel=0.25)
    assert trust.position_dc_rad < 0.2 * trust.position_amplitude_rad


def test_too_fast_a_motion_shows_in_both_checks(machine):
    """120 ms: clipped at times; variation and deviation both grow out of bounds (Fig. 10)."""
    trust = estimate(pair(0.12), machine, "denoised").trust
    assert trust.verdict == "unusable"
    assert trust.position_dc_rad > trust.position_amplitude_rad
    assert trust.relative_miv > RELATIVE_MIV[1]


def test_reasons_come_worst_first_and_carry_numbers(faster, machine, estimated):
    trust = estimate(pair(0.12), machine, "denoised").trust
    assert trust.reasons[0].startswith(
        f"expected error about {100 * trust.predicted_error:.2g} % of the inertia"
    )
    assert "unusable from 10 %" in trust.reasons[0]
    assert any(
        "windows of one period" in reason and "inject four phases" in reason for reason in trust.reasons
    )
    assert estimated(faster, machine).trust.reasons[0].endswith("(good below 3.5 %)")


def test_a_delayed_speed_is_said(fast, machine):
    """1 ms of delay is 18 degrees at 50 Hz: the imaginary part tells."""
    late = session_of(*(replace(run, speed_rad_s=np.roll(run.speed_rad_s, 4)) for run in fast.runs))
    trust = estimate(late, machine, "denoised", remove_delay=False).trust
    assert trust.verdict != "good"
    assert any("out of phase" in reason and "delays its speed" in reason for reason in trust.reasons)


def test_linear_axes_are_judged_in_their_own_units(faster, machine):
    trust = estimate(session_of(*faster.excited, axis="linear"), machine, "former").trust
    assert any(" kg within one period" in reason for reason in trust.reasons)
