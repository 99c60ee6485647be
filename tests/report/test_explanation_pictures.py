"""The pictures of an explanation, held against the signals that they are drawn from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from explanation_samples import (
    COULOMB,
    COULOMB_NM,
    HELD_OUT,
    NOISE_NM,
    OTHERS,
    Concealed,
    Explained,
    explained,
)
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from schwung.drivetrain.machine import Machine, paper_machine
from schwung.explain.values import Overlay
from schwung.explain.words import words_of
from schwung.motion import Array
from schwung.report.colours import ESTIMATE, EXCITED
from schwung.report.content import ROTARY
from schwung.report.explanation_terms import coupling_figure, term_figure
from schwung.report.figures_explanation import (
    judged,
    map_figure,
    overlay_figure,
    residual,
    shown_overlay,
)
from schwung.report.pictures_explanation import named_pictures

STIFFNESS = 24963.0


def _effect(physics: str) -> Concealed:
    return next(effect for effect in OTHERS if effect.physics == physics)


def _term(physics: str) -> Figure:
    explanation = explained((_effect(physics),))
    figure = term_figure(explanation.names[0], explanation.overlays, ROTARY)
    assert figure is not None
    return figure


def _law(*physics: str, believed: Machine | None = None) -> Axes:
    explanation = explained([_effect(name) for name in physics])
    figure = coupling_figure(explanation.names, explanation.overlays, believed or paper_machine(), ROTARY)
    assert figure is not None
    return figure.axes[0]


def _line(axes: Axes, label: str) -> tuple[Array, Array]:
    (line,) = [line for line in axes.lines if line.get_label() == label]
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def _shown(explanation: Explained) -> Overlay:
    run = shown_overlay(explanation.overlays)
    assert run is not None
    return run


def test_the_run_shown_was_kept_aside() -> None:
    assert _shown(explained()).run in HELD_OUT
    assert [run.run for run in judged(explained().overlays)] == list(HELD_OUT)
    without = tuple(run for run in explained().overlays if not run.heldout)
    assert _shown(replace(explained(), overlays=without)).run not in HELD_OUT
    assert shown_overlay(()) is None


def test_what_is_left_stands_against_the_floor() -> None:
    figure = overlay_figure(_shown(explained()), NOISE_NM, ROTARY)
    above, below, alone = figure.axes
    assert [text.get_text() for text in above.get_legend().get_texts()] == [
        "measured", "belief", "belief + physics",
    ]  # fmt: skip
    before, after = (np.asarray(line.get_ydata(), dtype=float) for line in below.lines[:2])
    assert np.nanmean(np.abs(before)) == pytest.approx(COULOMB_NM, rel=0.02)
    assert np.nanstd(after) == pytest.approx(NOISE_NM, rel=0.1)
    assert alone.get_ylim()[1] < 1.5
    band = below.collections[0].get_paths()[0].get_extents()
    assert (band.y0, band.y1) == pytest.approx((-2 * NOISE_NM, 2 * NOISE_NM))
    assert np.isnan(before[0])  # at rest nothing is compared


def test_where_noise_grows_with_the_torque_so_does_its_band() -> None:
    run = _shown(explained())
    below = overlay_figure(run, NOISE_NM, ROTARY, floor_share=0.1).axes[1]
    band = below.collections[0].get_paths()[0].get_extents()
    assert band.y1 == pytest.approx(2 * np.hypot(NOISE_NM, 0.1 * np.max(np.abs(run.torque_nm))))


def test_a_small_mismatch_needs_no_magnifying_glass() -> None:
    assert len(overlay_figure(_shown(explained(())), NOISE_NM, ROTARY, named=False).axes) == 2


def test_the_map_is_orange_forward_and_blue_backward_for_friction_and_fades_once_named() -> None:
    figure = map_figure(judged(explained().overlays), NOISE_NM, ROTARY)
    strength = []
    for axes in figure.axes:
        (cells,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
        colours = np.asarray(cells.get_facecolor())
        strength.append(colours[:, 3])
        for path, colour in zip(cells.get_paths(), colours, strict=True):
            speed = path.vertices[:4, 1].mean()
            if abs(speed) > 2 and axes is figure.axes[0]:
                wanted = EXCITED if speed > 0 else ESTIMATE
                assert 255 * colour[0] == pytest.approx(int(wanted.light[1:3], 16))
    assert strength[0].mean() > 0.8
    assert strength[1].max() < 3.5 * NOISE_NM / COULOMB_NM  # a cell may hold one sample
    assert strength[1].mean() < 0.06


def test_dots_are_what_the_recording_asks_of_this_term_alone() -> None:
    """With two effects at once, the dots of each are its own torque and noise."""
    viscous = _effect("viscous_friction")
    explanation = explained((COULOMB, viscous))
    figure = term_figure(explanation.names[1], explanation.overlays, ROTARY)
    assert figure is not None
    speed, asked = _line(figure.axes[0], "asked for by the recording")
    assert np.std(asked - 0.31 * speed) == pytest.approx(NOISE_NM, rel=0.1)
    speed, named = _line(figure.axes[0], "named")
    np.testing.assert_allclose(named, 0.31 * speed, atol=0.31 * 0.7)  # one bin's width


def test_a_tight_spot_has_two_branches_and_a_load_one() -> None:
    labels = {line.get_label() for line in _term("local_friction").axes[0].lines}
    assert {"named, forward", "named, backward"} <= labels
    labels = {line.get_label() for line in _term("load_torque").axes[0].lines}
    assert "named" in labels
    assert "named, backward" not in labels


def test_cogging_is_laid_on_two_of_its_periods() -> None:
    angle, torque = _line(_term("cogging").axes[0], "named")
    assert 0 <= angle.min() < angle.max() <= 4 * np.pi / 24
    np.testing.assert_allclose(torque, 2.5 * np.sin(24 * angle + 0.4), atol=0.15)


def test_the_slope_over_the_rate_of_torque_is_the_delay() -> None:
    rate, torque = _line(_term("measurement_delay").axes[0], "named")
    assert np.polyfit(rate, torque, 1)[0] == pytest.approx(1.5e-3, rel=0.02)


def test_clipped_torque_shows_to_its_end() -> None:
    axes = _term("torque_saturation").axes[0]
    _, torque = _line(axes, "named")
    assert axes.get_ylim()[1] > torque.max() > 0.5


def test_drift_is_drawn_run_by_run() -> None:
    run, change = _line(_term("friction_drift").axes[0], "named")
    np.testing.assert_allclose(change, 3 * run / 5, atol=0.02)


def test_a_disturbance_stands_at_its_frequency() -> None:
    axes = _term("periodic_disturbance").axes[0]
    frequency, amplitude = _line(axes, "without it")
    assert frequency[amplitude.argmax()] == pytest.approx(37.0, abs=1.5)
    assert amplitude.max() == pytest.approx(2.0, rel=0.1)
    _, left = _line(axes, "with it")
    assert left.max() < 0.1
    assert "37 Hz" in [text.get_text() for text in axes.texts]


@pytest.mark.parametrize(
    ("physics", "wind_up_of"),
    [
        (["coupling_stiffness"], lambda torque: torque / 17000.0),
        (["backlash"], lambda torque: torque / STIFFNESS + 1e-3 * np.sign(torque)),
        (["coupling_stiffness", "backlash"], lambda torque: torque / 17000.0 + 1e-3 * np.sign(torque)),
    ],
)
def test_the_coupling_is_drawn_over_its_wind_up(
    physics: list[str], wind_up_of: Callable[[Array], Array]
) -> None:
    axes = _law(*physics)
    wind_up, torque = _line(axes, "belief")
    np.testing.assert_allclose(wind_up, 1e3 * torque / STIFFNESS)
    wind_up, torque = _line(axes, "belief + physics")
    np.testing.assert_allclose(wind_up, 1e3 * wind_up_of(torque))


def test_a_stiffening_coupling_keeps_its_law() -> None:
    wind_up, torque = _line(_law("nonlinear_stiffness"), "belief + physics")
    back = STIFFNESS * wind_up / 1e3 + 3e9 * (wind_up / 1e3) ** 3
    np.testing.assert_allclose(back, torque, atol=1e-2)


def test_a_rigid_belief_is_a_vertical_line() -> None:
    axes = _law("backlash", believed=paper_machine().model_copy(update={"coupling": None}))
    wind_up, _ = _line(axes, "belief: rigid")
    assert np.all(wind_up == 0)
    wind_up, _ = _line(axes, "belief + physics")
    assert np.unique(wind_up).tolist() == pytest.approx([-1.0, 0.0, 1.0])


def test_a_term_without_signals_is_left_out() -> None:
    explanation = explained()
    bare = tuple(replace(run, terms_nm={}) for run in explanation.overlays)
    assert term_figure(explanation.names[0], bare, ROTARY) is None


def test_an_event_is_drawn_since_the_motion_began_where_that_is_known() -> None:
    explanation = explained((_effect("load_event"),))
    axes = _term("load_event").axes[0]
    time, torque = _line(axes, "named")
    assert axes.get_xlabel() == "time in the run, s"
    assert time[torque.argmax()] == pytest.approx(0.31, abs=0.01)
    since = tuple(replace(run, motion_time_s=run.time_s - 0.1) for run in explanation.overlays)
    figure = term_figure(explanation.names[0], since, ROTARY)
    assert figure is not None
    time, torque = _line(figure.axes[0], "named")
    assert figure.axes[0].get_xlabel() == "time since the motion began, s"
    assert time[torque.argmax()] == pytest.approx(0.21, abs=0.01)


def test_residuals_are_unknown_where_nothing_is_compared() -> None:
    run = explained().overlays[0]
    left = residual(run, run.after_nm)
    assert np.array_equal(np.isnan(left), run.considered == 0)


def test_words_follow_the_axis() -> None:
    assert words_of("torque_lag", linear=True).name == "a force that lags"


def test_every_physics_of_these_has_a_picture() -> None:
    effects = (COULOMB, *OTHERS)
    told = explained(effects)
    law = [number for number, effect in enumerate(effects) if words_of(effect.physics).view == "wind_up"]
    drawn = [picture.name for picture in named_pictures(told.names, told.overlays, paper_machine(), ROTARY)]
    assert drawn == [*(f"term{i}" for i in range(len(effects)) if i not in law), "coupling"]
