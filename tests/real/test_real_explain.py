"""What `explain` finds in recordings of machines that nobody here has built, held against what is published of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from real_recordings import RealRecordings, emps_machine, hsm150_machine, pendulum_machine

from schwung.drivetrain import Machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.explain import explain
from schwung.explain.free_run import free_runs
from schwung.explain.values import Explanation, Finding
from schwung.motion import Array

#: Published of EMPS (Janot, Gautier, Brunot 2019): N·s/m, N, N.
VISCOUS, COULOMB, OFFSET = 203.5034, 20.3935, -3.1648
#: Force residual of the published model, N rms: estimation record, validation record.
PUBLISHED_RMS, PUBLISHED_PULSES_RMS = 2.2, 3.4


@cache
def emps(recordings: RealRecordings) -> Explanation:
    return explain(recordings.emps, emps_machine())


@cache
def pendulum(recordings: RealRecordings, name: str) -> Explanation:
    return explain(recordings.pendulum(name), pendulum_machine())


def found(explanation: Explanation) -> Mapping[str, Finding]:
    return {finding.physics: finding for finding in explanation.findings}


def value(finding: Finding, key: str) -> float:
    number = finding.parameters[key].value
    assert isinstance(number, float)
    return number


def torque_over_angle(finding: Finding) -> tuple[Array, Array]:
    """A load torque over ±1.5 rad, where all swings were, however it is given."""
    angle = np.linspace(-1.5, 1.5, 31)
    table = finding.parameters.get("table")
    if table is not None:
        assert isinstance(table.value, tuple)
        knots, torques = np.array(table.value).T
        return angle, np.interp(angle, knots, torques)
    return angle, value(finding, "amplitude_nm") * np.sin(angle + value(finding, "phase_rad"))


def published_emps() -> Machine:
    terms = (
        PhysicsTerm(name="viscous_friction", coefficient_nms=VISCOUS),
        PhysicsTerm(name="coulomb_friction", torque_nm=COULOMB),
        PhysicsTerm(name="torque_offset", torque_nm=-OFFSET),
    )
    return emps_machine().model_copy(update={"physics": terms})


def test_emps_viscous_and_coulomb_friction_are_the_published_ones(recordings: RealRecordings) -> None:
    named = found(emps(recordings))
    assert set(named) == {"viscous_friction", "asymmetric_friction", "cogging"}
    # the published model has one viscous coefficient and an offset for both directions: a few per cent may move
    assert value(named["viscous_friction"], "coefficient_nms") == pytest.approx(VISCOUS, rel=0.03)
    dry = named["asymmetric_friction"]
    levels = [value(dry, "torque_positive_nm"), value(dry, "torque_negative_nm")]
    assert np.mean(levels) == pytest.approx(COULOMB, rel=0.05)
    assert dry.parameters["torque_positive_nm"].unit == "N"


def test_emps_asymmetry_takes_the_place_of_the_published_offset(recordings: RealRecordings) -> None:
    """At half the highest speed, friction forwards less friction backwards is twice the published offset."""
    dry = found(emps(recordings))["asymmetric_friction"]
    speed = 0.08  # m/s, root mean square of the record while it moves
    difference = value(dry, "torque_positive_nm") - value(dry, "torque_negative_nm")
    difference += value(dry, "coefficient_difference_nms") * speed
    assert difference == pytest.approx(2 * OFFSET, rel=0.15)


def test_emps_ripple_has_the_period_that_is_known(recordings: RealRecordings) -> None:
    ripple = found(emps(recordings))["cogging"]
    assert ripple.parameters["order"].unit == "1/m"
    assert 2 * np.pi / value(ripple, "order") == pytest.approx(2.5e-3, rel=2e-3)
    assert 0.5 < value(ripple, "amplitude_nm") < 1.5  # about 1 N, from the spectrum over position


def test_emps_is_partly_explained_beyond_what_was_published(recordings: RealRecordings) -> None:
    explanation = emps(recordings)
    assert explanation.verdict == "partly_explained"
    assert explanation.remainder
    assert explanation.fit.heldout_runs == (3,)
    assert explanation.fit.before.torque_rmse_nm == pytest.approx(37, abs=2)
    # the comparison here reaches to 180 Hz, the published one to 20 Hz: even so it is to be better
    assert explanation.fit.after.torque_rmse_nm < 0.8 * PUBLISHED_RMS
    assert explanation.noise_floor.torque_nm < explanation.fit.after.torque_rmse_nm


def test_emps_pulses_tell_the_same(recordings: RealRecordings) -> None:
    session = recordings.emps_pulses
    explanation = explain(replace(session, runs=session.runs[:2]), emps_machine())
    named, estimated = found(explanation), found(emps(recordings))
    for term, key in (
        ("viscous_friction", "coefficient_nms"),
        ("asymmetric_friction", "coefficient_difference_nms"),
    ):
        assert value(named[term], key) == pytest.approx(value(estimated[term], key), rel=0.06)
    assert explanation.fit.after.torque_rmse_nm < PUBLISHED_PULSES_RMS


def test_emps_free_run_of_the_validation_record(recordings: RealRecordings) -> None:
    """Published baselines: 5.2 to 5.5 mm RMS over the record."""
    (published,) = free_runs(published_emps(), recordings.emps)
    assert published.duration_s == pytest.approx(24.841)
    assert published.position_rms_rad == pytest.approx(5.3e-3, abs=0.4e-3)
    (learned,) = free_runs(emps(recordings).machine, recordings.emps_pulses)
    (baseline,) = free_runs(published_emps(), recordings.emps_pulses)
    assert learned.position_rms_rad < 6.5e-3 < baseline.position_rms_rad
    assert any("mm RMS" in note for note in emps(recordings).notes)


def test_the_pendulum_hides_gravity(recordings: RealRecordings) -> None:
    explanation = pendulum(recordings, "ddp")
    assert explanation.verdict in ("partly_explained", "explained")
    gravity = explanation.findings[0]
    assert gravity.physics == "load_torque"
    angle, torque = torque_over_angle(gravity)
    sine = float(np.sum(torque * np.sin(angle)) / np.sum(np.sin(angle) ** 2))
    # m g l is 2.98 N·m by the data sheet, hanging down at 0; torque is reported by a constant that is off by some 10 %
    assert sine == pytest.approx(-2.98, rel=0.2)
    # and J is 0.15 kg·m²: reported torque is 1.05 to 1.25 times what that takes, the data sheet's m g l alike
    (scale,) = (note for note in explanation.notes if "believed inertia takes" in note)
    assert 1.05 < float(scale.partition("reported torque is ")[2].split()[0]) < 1.25
    assert "cannot tell torque_constant from load_inertia" in scale
    assert any("not proven" in note for note in explanation.notes)


def test_the_pendulum_of_ddp_swings_up_by_torque_alone(recordings: RealRecordings) -> None:
    session = recordings.pendulum("ddp")
    (driven,) = free_runs(pendulum(recordings, "ddp").machine, session)
    assert driven.position_rms_rad < 0.05 * float(np.ptp(session.runs[0].position_rad))


def test_hsm150_names_no_inertia_and_says_why(recordings: RealRecordings) -> None:
    names = [f"{side}_{repeat}" for side in ("neg_0.04", "pos_0.06") for repeat in (1,)]
    explanation = explain(recordings.hsm150(*names), hsm150_machine())
    assert any("does not determine the inertia" in note for note in explanation.notes)
    assert explanation.verdict != "explained"
    assert all("friction" in finding.physics for finding in explanation.findings)
