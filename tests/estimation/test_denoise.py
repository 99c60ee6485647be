"""Pairing and subtraction: which reference goes with which run, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from estimation_plant import motion_of, session_of

from schwung.errors import InputError
from schwung.estimation.denoise import denoise
from schwung.motion import Motion


def test_the_motion_has_gone(fast):
    (pair,) = denoise(fast, fast.excited)
    reference, excited = fast.runs
    np.testing.assert_allclose(pair.speed_rad_s, excited.speed_rad_s - reference.speed_rad_s)
    np.testing.assert_allclose(pair.torque_nm, excited.torque_nm - reference.torque_nm)
    assert np.max(np.abs(reference.speed_rad_s)) > 15
    assert np.max(np.abs(pair.speed_rad_s)) < 3, "what is left is the ripple"
    assert np.max(np.abs(pair.position_deviation_rad)) < 0.02
    assert pair.reference is reference


def test_repeats_are_paired_with_their_own_reference(repeats):
    pairs = denoise(repeats, repeats.excited)
    assert [(p.excited.repeat, p.reference.repeat) for p in pairs] == [(0, 0), (1, 1), (2, 2)]


def test_a_repeat_without_reference_takes_the_mean_of_all(repeats):
    references, alone = repeats.references, replace(repeats.excited[0], repeat=9)
    (pair,) = denoise(session_of(*references, alone), [alone])
    np.testing.assert_allclose(
        pair.reference.speed_rad_s, np.mean([run.speed_rad_s for run in references], axis=0)
    )


def test_keys_of_later_versions_do_not_make_another_motion(fast):
    reference, excited = fast.runs
    marked = Motion.model_validate({**excited.motion.model_dump(), "operator": "me"})
    assert (
        len(
            denoise(session_of(reference, replace(excited, motion=marked)), [replace(excited, motion=marked)])
        )
        == 1
    )


def shifted(run, samples):
    """The run as if triggered `samples` late: it rests that much longer."""

    def late(values):
        return np.concatenate([np.full(samples, values[0]), values[:-samples]])

    return replace(run, position_rad=late(run.position_rad), speed_rad_s=late(run.speed_rad_s),
                   torque_nm=late(run.torque_nm))  # fmt: skip


def cut(run, samples):
    return replace(
        run,
        **{
            name: getattr(run, name)[:samples]
            for name in ("time_s", "position_rad", "speed_rad_s", "torque_nm")
        },
    )


def moved(run, offset):
    return replace(run, position_rad=run.position_rad + offset)


REFUSED = {
    "no reference": (lambda r, e: [e], "no reference run.*former"),
    "other motion": (lambda r, e: [replace(r, motion=motion_of(0.3)), e], "no reference run has its motion"),
    "no motion": (lambda r, e: [replace(r, motion=None), e], "no reference run has its motion"),
    "length": (lambda r, e: [cut(r, len(r) - 200), e], "samples"),
    "clock": (lambda r, e: [replace(r, time_s=r.time_s + 0.01), e], "40.0 samples apart"),
    "late trigger": (lambda r, e: [r, shifted(e, 80)], r"(19|20)\.\d ms later"),
    "early trigger": (lambda r, e: [shifted(r, 80), e], r"(19|20)\.\d ms earlier"),
    "one sample late": (lambda r, e: [r, shifted(e, 1)], r"0\.[23] ms later"),
    "other place": (lambda r, e: [moved(r, 0.3), e], "do not follow one path"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_runs_that_do_not_align_are_named(fast, case):
    spoil, said = REFUSED[case]
    session = session_of(*spoil(*fast.runs))
    with pytest.raises(InputError, match=said) as caught:
        denoise(session, session.excited)
    assert caught.value.remedy


def test_rates_must_agree(fast, bus_rate):
    session = session_of(bus_rate.runs[0], fast.runs[1])
    with pytest.raises(InputError, match="4000 and 1000 Hz"):
        denoise(session, session.excited)


def test_a_few_samples_more_do_not_matter(fast):
    reference, excited = fast.runs
    session = session_of(cut(reference, len(reference) - 7), excited)
    (pair,) = denoise(session, session.excited)
    assert pair.time_s.size == pair.torque_nm.size == len(reference) - 7
