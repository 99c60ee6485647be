"""A periodic disturbance: the waveform that all runs share, wherever in it they begin."""

import re
from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from sealed_sessions import fewer
from strangers import STRANGERS, Stranger, belief_of, session_of

from schwung.explain.causes.along import Ranges
from schwung.explain.causes.vocabulary.periodic import periodic
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.growth import Growth
from schwung.explain.weighing.round import View
from schwung.explain.weighing.weigh import weigh

RANGES = Ranges(0.0, 4.0, 50.0, 2000.0, 40.0, 1.0, 0.1, 3, 160.0)
HERTZ, STEP_S = 71.3, 1e-3
ALONG = SimpleNamespace(
    time_s=STEP_S * np.arange(800), speed=np.ones(800), number=1, run=SimpleNamespace(step_s=STEP_S)
)


def test_columns_of_a_waveform_are_the_slope_of_what_it_does() -> None:
    """By each run's own sine, too: it turns the harmonics with it."""
    _, waveform = periodic(RANGES, 6.0)
    found = np.random.default_rng(2).standard_normal(waveform.size)
    columns = waveform.about(found).effect(ALONG, (HERTZ,)).parts[0]
    for which, step in enumerate(1e-6 * np.eye(found.size)):
        ahead, behind = (waveform.done(ALONG, (HERTZ,), found + way * step).parts[0] for way in (1, -1))
        np.testing.assert_allclose(columns[:, which], (ahead - behind)[:, 0] / 2e-6, atol=1e-5)
    shown = [bool(np.any(column)) for column in columns.T]
    mine, harmonics = [False, False, True, True, False, False], [order * HERTZ < 500 for order in range(2, 9)]
    assert shown == [*mine, *harmonics, *harmonics]


def test_of_a_run_without_a_phase_no_harmonics_are_known() -> None:
    sine, waveform = periodic(RANGES, 6.0)
    found = np.ones(waveform.size)
    found[2:4] = 0.0
    columns = waveform.about(found).effect(ALONG, (HERTZ,)).parts[0]
    np.testing.assert_array_equal(columns[:, :6], sine.effect(ALONG, (HERTZ,)).parts[0])
    assert not np.any(columns[:, 6:])


@pytest.mark.long
def test_harmonics_of_a_rectangular_hum_are_its_own() -> None:
    """Beyond the band in which lines are looked for they were anything; what no file can say is told."""
    stranger = STRANGERS[12]
    session = fewer(session_of(stranger, 5, every=4, times=(0.25, 0.4)), 2)
    found = publish(session, belief_of(stranger))
    (name,) = [one for one in found.names if one.probability > 0.02]
    assert (name.physics, name.in_file) == ("periodic_disturbance", True)
    amplitude, hertz = stranger.hum
    assert name.parameters["amplitude_nm"].value == pytest.approx(4 / np.pi * amplitude, rel=0.03)
    assert name.parameters["frequency_hz"].value == pytest.approx(hertz, abs=0.02)
    (note,) = [note for note in found.notes if note.startswith("periodic_disturbance")]
    assert "machine.toml cannot say its harmonics" in note
    told = {float(at): float(size) for size, at in re.findall(r"([\d.]+) N·m at ([\d.]+) Hz", note)}
    assert {round(at / hertz) for at in told} <= {3, 5, 7}
    assert told[213.9] == pytest.approx(4 / np.pi * amplitude / 3, rel=0.1)


class _LookedAtError(Exception):
    """Ends a search whose set is known."""


@pytest.mark.long
def test_a_hum_found_in_few_runs_is_in_the_set_at_rest_and_in_what_is_scored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They were two sets: the states had the hum, the probabilities were those without one."""
    stranger = Stranger("hum, dry friction", (), (0.8, 0.0, 0.0, 0.0), hum=(0.3, HERTZ))

    def grown(growth: Growth, view: View) -> None:
        climbed = replace(growth, every=growth.rests.train).climbed(growth.nothing(view), ())
        scored = [climbed.search.candidate(pick).name for pick in climbed.best.picks]
        assert sorted(scored) == ["coulomb_friction", "periodic_disturbance"]
        assert [member.candidate.name for member in climbed.at.members[-2:]] == scored
        raise _LookedAtError

    monkeypatch.setattr(import_module("schwung.explain.weighing.weigh"), "grown", grown)
    # which may mend it
    monkeypatch.setattr(import_module("schwung.explain.weighing.growth"), "exchanged", lambda *_: None)
    with pytest.raises(_LookedAtError):
        weigh(fewer(session_of(stranger, 5, every=8, times=(0.25, 0.4)), 1), belief_of(stranger))
