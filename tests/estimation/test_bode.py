"""Responses and the fit to them, against exact physics that knows nothing of the product."""

from dataclasses import replace

import numpy as np
import pytest
from bode_plant import (
    DAMPING,
    LINES,
    LOAD_FRICTION,
    ROTOR,
    ROTOR_FRICTION,
    STIFFNESS,
    multisine,
    record,
    session,
    sine,
)

from schwung.drivetrain import paper_machine
from schwung.drivetrain.response import torque_to_speed
from schwung.errors import InputError
from schwung.estimation.bode import fit_bode
from schwung.estimation.bode_model import mobility
from schwung.estimation.response import Response, measured_responses

LOADS = {0.2: 0.0615, 1.5: 0.16}


@pytest.fixture(scope="module")
def recorded():
    return session(*(record(angle, load, multisine()) for angle, load in LOADS.items()))


@pytest.fixture(scope="module")
def fitted(recorded):
    return fit_bode(measured_responses(recorded))


def _exact(frequency, load, rotor=ROTOR, stiffness=STIFFNESS):
    """ω_r/T_m written out once more, from (1) of the paper."""
    s = 2j * np.pi * frequency
    z, c = load * s + LOAD_FRICTION, DAMPING + stiffness / s
    return 1 / (rotor * s + ROTOR_FRICTION + c * z / (c + z))


def _synthetic(load, share, rng, frequency=LINES, **machine):
    """A response with complex noise of a known share, as sampled continuously at 8 kHz."""
    exact = _exact(frequency, load, **machine)
    std = share * np.abs(exact)
    error = (rng.normal(size=std.size) + 1j * rng.normal(size=std.size)) * std / np.sqrt(2)
    ones = np.ones_like(std)
    return Response(load, frequency, exact + error, std, ones, 0j * ones, std, 8000.0, None, 8)


def test_every_parameter_comes_out_within_its_interval_through_a_held_injection(fitted):
    for name, truth in (("rotor", ROTOR), ("stiffness", STIFFNESS), ("damping", DAMPING)):
        found = getattr(fitted, name)
        assert abs(found.value - truth) < 3 * found.std, name
        assert found.value == pytest.approx(truth, rel=0.03), name
    assert fitted.stiffness.value == pytest.approx(STIFFNESS, rel=2e-3)
    for angle, load in zip(fitted.angles, LOADS.values(), strict=True):
        assert abs(angle.inertia.value - load) < 3 * angle.inertia.std
        assert angle.inertia.value == pytest.approx(load, rel=3e-3)
        assert angle.anti_resonance.value == pytest.approx(np.sqrt(STIFFNESS / load) / 2 / np.pi, rel=1e-3)
        resonance = np.sqrt(STIFFNESS * (1 / ROTOR + 1 / load)) / 2 / np.pi
        assert abs(angle.resonance.value - resonance) < 3 * angle.resonance.std
    assert fitted.coupled
    assert 0.3 < fitted.chi2 < 3


def test_the_corrected_points_lie_on_the_open_loop(fitted):
    for response, corrected, load in zip(fitted.responses, fitted.corrected, LOADS.values(), strict=True):
        exact = _exact(response.frequency_hz, load)
        assert np.max(np.abs(corrected / exact - 1)[response.used]) < 0.05
        assert np.median(np.abs(corrected / exact - 1)) < 0.01
        assert np.min(response.coherence) > 0.99


def test_a_staircase_taken_for_a_continuous_injection_gives_another_machine(recorded, fitted):
    """What the images do when nobody knows of them: the effect that the model is there for."""
    naive = session(
        *(
            replace(
                run,
                excitation=run.excitation.model_copy(update={"hold_s": None}),
                extra={"speed_source": "position"},
            )
            for run in recorded.runs
        )
    )
    found = fit_bode(measured_responses(naive))
    assert abs(found.rotor.value / ROTOR - 1) > 0.08
    assert found.chi2 > 5 * fitted.chi2
    assert abs(found.damping.value / DAMPING - 1) > 3 * abs(fitted.damping.value / DAMPING - 1)


def test_a_late_angle_is_found_as_a_delay_and_does_not_pass_for_damping():
    late = session(*(record(a, load, multisine(), latency_ticks=4) for a, load in LOADS.items()))
    found = fit_bode(measured_responses(late))
    assert found.delay.value == pytest.approx(4 * 125e-6, abs=25e-6)
    assert abs(found.damping.value - DAMPING) < 3 * found.damping.std
    assert found.damping.value == pytest.approx(DAMPING, rel=0.05)


@pytest.mark.parametrize("rate", [500, 200])
def test_images_carry_what_lies_above_the_band_and_another_minimum_is_not_taken_for_it(rate):
    """At 200 Hz both anti-resonance and resonance are out of reach, and wrong machines fit to a few per cent."""
    lines = LINES[0.4 * rate >= LINES]
    runs = [record(a, load, multisine(lines=lines, rate=rate), rate=rate) for a, load in LOADS.items()]
    found = fit_bode(measured_responses(session(*runs)))
    pairs = [(found.rotor, ROTOR), (found.stiffness, STIFFNESS), (found.damping, DAMPING)]
    pairs += [(a.inertia, load) for a, load in zip(found.angles, LOADS.values(), strict=True)]
    for fitted, truth in pairs:
        assert abs(fitted.value - truth) < 3 * fitted.std
    assert found.stiffness.value == pytest.approx(STIFFNESS, rel=0.05)
    assert any("resonance" in note and "above" in note for note in found.notes)
    assert found.ambiguous == any("another machine" in note for note in found.notes)


def test_a_stepped_sine_agrees_with_the_multisine():
    lines = np.array([20.0, 40, 55, 60, 65, 70, 80, 110, 150, 200, 230, 250, 300, 360])
    runs = [record(1.5, 0.16, sine(float(f), amplitude=min(30.0, f / 2))) for f in lines]
    responses = measured_responses(session(*runs))
    assert len(responses) == 1
    assert np.array_equal(responses[0].frequency_hz, lines)
    found = fit_bode(responses)
    assert found.stiffness.value == pytest.approx(STIFFNESS, rel=5e-3)
    assert found.angles[0].inertia.value == pytest.approx(0.16, rel=5e-3)
    assert abs(found.rotor.value - ROTOR) < 3 * found.rotor.std


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Of 80 errors, in their own standard deviations: their mean square is 1, give or take 0.16."""
    rng, inside, off = np.random.default_rng(4), [], []
    for _ in range(16):
        found = fit_bode([_synthetic(load, 0.02, rng) for load in LOADS.values()])
        pairs = [(found.rotor, ROTOR), (found.stiffness, STIFFNESS), (found.damping, DAMPING)]
        pairs += [(a.inertia, load) for a, load in zip(found.angles, LOADS.values(), strict=True)]
        inside += [f.ci95[0] <= truth <= f.ci95[1] for f, truth in pairs]
        off += [(f.value - truth) / f.std for f, truth in pairs]
    assert np.mean(inside) >= 0.89
    assert 0.6 < np.mean(np.square(off)) < 1.5


@pytest.mark.parametrize("scale", [1e-6, 1e3])
def test_start_values_fit_machines_of_any_size(scale):
    rng = np.random.default_rng(0)
    responses = []
    for load in LOADS.values():
        exact = _synthetic(load, 0.01, rng)
        responses.append(replace(exact, response=exact.response / scale, std=exact.std / scale))
    found = fit_bode(responses)
    assert found.stiffness.value == pytest.approx(STIFFNESS * scale, rel=0.02)
    assert found.angles[1].inertia.value == pytest.approx(0.16 * scale, rel=0.02)


def test_a_band_that_ends_below_the_resonance_says_what_it_cannot_tell():
    rng = np.random.default_rng(1)
    low = LINES[LINES <= 130]
    found = fit_bode([_synthetic(load, 0.01, rng, low) for load in LOADS.values()])
    whole = fit_bode([_synthetic(load, 0.01, rng) for load in LOADS.values()])
    assert any("resonance" in note and "above" in note for note in found.notes)
    assert not any("above 4" in note for note in whole.notes)
    assert found.rotor.std > 3 * whole.rotor.std
    assert found.rotor.ci95[0] <= ROTOR <= found.rotor.ci95[1]


def test_a_machine_stiffer_than_the_band_shows_is_called_one_mass():
    rng = np.random.default_rng(2)
    stiff = [_synthetic(load, 0.01, rng, stiffness=STIFFNESS * 1e4) for load in LOADS.values()]
    found = fit_bode(stiff, paper_machine())
    assert not found.coupled
    assert found.stiffness is None
    assert any("cannot be determined" in note for note in found.notes)
    assert found.angles[1].inertia.value == pytest.approx(0.16, rel=0.01)
    assert found.machine(paper_machine()).motor.inertia_kgm2 == ROTOR


def test_what_is_not_determined_keeps_the_belief(fitted):
    believed = paper_machine()
    machine = fitted.machine(believed)
    assert machine.coupling.stiffness_nm_rad == fitted.stiffness.value
    assert machine.load.inertia_table.inertia_kgm2 == pytest.approx(list(LOADS.values()), rel=0.01)
    vague = replace(fitted, rotor=replace(fitted.rotor, std=fitted.rotor.value))
    assert vague.machine(believed).motor.inertia_kgm2 == believed.motor.inertia_kgm2


def test_dry_friction_passes_for_viscous_at_standstill_and_does_not_get_into_the_machine(fitted):
    """Its describing function is real: 4 T_c/(π ω) of the vibration's speed, here as large as 3 N·m·s/rad."""
    rng = np.random.default_rng(8)
    plain = [_synthetic(load, 0.005, rng) for load in LOADS.values()]
    sticky = fit_bode([replace(r, response=1 / (1 / r.response + 3.0)) for r in plain])
    assert sticky.rotor_friction.value == pytest.approx(3.2, abs=0.1)
    assert sticky.stiffness.value == pytest.approx(STIFFNESS, rel=0.01)
    assert any("dry friction" in note for note in sticky.notes)
    assert sticky.machine(paper_machine()).motor == paper_machine().motor.model_copy(
        update={"inertia_kgm2": sticky.rotor.value}
    )


def test_a_compliance_that_the_model_lacks_is_said_and_widens_the_intervals():
    rng = np.random.default_rng(3)
    plain = [_synthetic(load, 0.005, rng) for load in LOADS.values()]
    s = 2j * np.pi * LINES
    third = 0.002 * s / (1 + 0.002 * s**2 / 900.0 + 1e-4 * s)  # a further mass on the motor, at 107 Hz
    changed = [replace(r, response=1 / (1 / r.response + third)) for r in plain]
    honest, misled = fit_bode(plain), fit_bode(changed)
    assert misled.chi2 > 4 * honest.chi2
    assert any("times their spread" in note for note in misled.notes)
    assert misled.stiffness.std > 2 * honest.stiffness.std


def test_the_model_is_the_product_s_own_response():
    machine = paper_machine()
    p = {
        "rotor": ROTOR, "rotor_friction": ROTOR_FRICTION, "stiffness": STIFFNESS, "damping": DAMPING,
        "load_friction": LOAD_FRICTION,
    }  # fmt: skip
    here = mobility(p, 0.11, 2j * np.pi * LINES)
    assert here == pytest.approx(torque_to_speed(machine, 0.11, LINES), rel=1e-12)
    assert here == pytest.approx(_exact(LINES, 0.11), rel=1e-12)


def test_wrong_recordings_are_named(recorded):
    run = recorded.runs[0]
    with pytest.raises(InputError, match="sign of torque"):
        measured_responses(
            session(replace(run, torque_nm=-run.torque_nm, torque_added_nm=-run.torque_added_nm))
        )
    short = replace(
        run,
        **{
            name: getattr(run, name)[:1400]
            for name in ("time_s", "position_rad", "speed_rad_s", "torque_nm", "torque_added_nm")
        },
    )
    with pytest.raises(InputError, match="Record more periods"):
        measured_responses(session(short))
    with pytest.raises(InputError, match="standstill"):
        measured_responses(session(replace(run, position_rad=np.linspace(0, 3, len(run)))))
    response = measured_responses(session(run))[0]
    with pytest.raises(InputError, match="coherence"):
        fit_bode([replace(response, coherence=0.1 * response.coherence)])
