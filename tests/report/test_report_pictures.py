"""The pictures: what they show, in colours that everybody can tell apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from report_samples import MOTION, SINE, bare, estimated, full, session

from schwung.errors import InputError
from schwung.estimation.trust import RELATIVE_MIV
from schwung.motion import Array
from schwung.report.colours import (
    DOUBTFUL,
    ESTIMATE,
    EXCITED,
    FORMER,
    GOOD,
    GRID,
    INK,
    PALETTE,
    PLAIN,
    SURFACE,
    UNUSABLE,
    Colour,
    thin,
)
from schwung.report.pictures import Picture, pictures, save_figures

#: Full dichromacy: Machado, Oliveira and Fernandes, IEEE TVCG 15:6 (2009), table 1, severity 1.0, linear RGB.
_VISION = {
    "usual": np.eye(3),
    "protan": np.array([
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]
    ]),
    "deutan": np.array([
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]
    ]),
    "tritan": np.array([
        [1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]
    ]),
}  # fmt: skip
_TOGETHER = [
    (ESTIMATE, FORMER), (ESTIMATE, INK), (FORMER, INK), (EXCITED, PLAIN), (EXCITED, INK), (PLAIN, GOOD),
    (DOUBTFUL, UNUSABLE),
]  # fmt: skip


def _linear(code: str) -> Array:
    """sRGB "#rrggbb" to linear RGB, (3,) (IEC 61966-2-1)."""
    share = np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _lab(linear: Array) -> Array:
    """Linear RGB to CIE L*a*b*, D65."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = np.cbrt(to_xyz @ np.clip(linear, 1e-3, 1) / [0.9505, 1.0, 1.089])
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def _contrast(one: str, other: str) -> float:
    """Contrast ratio of WCAG 2.1."""
    light = sorted(float(np.array([0.2126, 0.7152, 0.0722]) @ _linear(code)) for code in (one, other))
    return (light[1] + 0.05) / (light[0] + 0.05)


@pytest.fixture(scope="module")
def drawn() -> dict[str, Picture]:
    return {picture.name: picture for picture in pictures(full())}


def _named(picture: Picture, label: str, axes: int = 0) -> Array:
    """The y-data of the curve with that label."""
    lines = [line for line in picture.figure.axes[axes].lines if line.get_label() == label]
    assert len(lines) == 1
    return np.asarray(lines[0].get_ydata(), dtype=float)


@pytest.mark.parametrize("colour", [c for c in PALETTE if c not in (GRID, SURFACE)], ids=lambda c: c.name)
def test_words_in_every_colour_can_be_read(colour: Colour) -> None:
    assert _contrast(colour.light, SURFACE.light) >= 4.5  # WCAG 2.1, 1.4.3, level AA
    assert _contrast(colour.dark, SURFACE.dark) >= 4.5


@pytest.mark.parametrize("vision", _VISION)
@pytest.mark.parametrize(("one", "other"), _TOGETHER, ids=lambda c: c.name)
def test_curves_that_meet_are_told_apart(one: Colour, other: Colour, vision: str) -> None:
    for theme in ("light", "dark"):
        first, second = (_lab(_VISION[vision] @ _linear(getattr(c, theme))) for c in (one, other))
        assert np.linalg.norm(first - second) >= 20


def test_inertia_shows_estimate_reference_and_contrast(drawn: dict[str, Picture]) -> None:
    content, picture = full(), drawn["inertia"]
    assert content.estimate is not None
    assert content.contrast is not None
    np.testing.assert_array_equal(_named(picture, "estimate ± 2σ"), content.estimate.table.inertia_kgm2)
    np.testing.assert_array_equal(_named(picture, "former method"), content.contrast.table.inertia_kgm2)
    assert _named(picture, content.reference_label).size == 400
    low, high = picture.figure.axes[0].get_ylim()
    assert low == 0
    assert high > content.estimate.table.inertia_kgm2.max()
    assert "the former method" in picture.caption


def test_limits_of_variation_are_those_of_the_verdict(drawn: dict[str, Picture]) -> None:
    estimate = estimated()
    levels = [
        line.get_ydata()[0]
        for line in drawn["variation"].figure.axes[0].lines
        if line.get_linestyle() == "--"
    ]
    mean = float(np.mean(estimate.table.inertia_kgm2))
    np.testing.assert_allclose(levels, [share * mean for share in RELATIVE_MIV])
    texts = [text.get_text() for text in drawn["variation"].figure.axes[0].texts]
    assert f"MIV {estimate.trust.miv_kgm2:.3g}" in texts


def test_a_variation_beyond_the_picture_is_still_named() -> None:
    estimate = estimated()
    traces = tuple(replace(t, inertia_variation_kgm2=100 * t.inertia_variation_kgm2) for t in estimate.traces)
    trust = replace(estimate.trust, miv_kgm2=100 * estimate.trust.miv_kgm2)
    content = replace(bare(), estimate=replace(estimate, traces=traces, trust=trust))
    axes = next(p for p in pictures(content) if p.name == "variation").figure.axes[0]
    label = next(text for text in axes.texts if text.get_text().startswith("MIV"))
    assert 0 < label.xy[1] < axes.get_ylim()[1]
    assert label.get_text() == f"MIV {trust.miv_kgm2:.3g}"


def test_a_method_without_imaginary_part_has_no_panel_for_it() -> None:
    estimate = estimated()
    traces = tuple(replace(t, imaginary_kgm2=0 * t.imaginary_kgm2, stroke=None) for t in estimate.traces)
    content = replace(bare(), estimate=replace(estimate, traces=traces))
    picture = next(p for p in pictures(content) if p.name == "variation")
    assert len(picture.figure.axes) == 1
    assert "imaginary" not in picture.caption


def test_amplitude_envelops_the_denoised_speed(drawn: dict[str, Picture]) -> None:
    """In the dwell before the stroke the sine is steady: its envelope is its peak."""
    lines = drawn["denoised"].figure.axes[0].lines
    signal, envelope = lines[0], lines[1]
    time = np.asarray(signal.get_xdata(), dtype=float)
    steady = (time > SINE.ramp_s + 0.02) & (time < MOTION.start_time_s)
    height = np.interp(MOTION.start_time_s - 0.02, envelope.get_xdata(), envelope.get_ydata())
    assert np.max(np.abs(np.asarray(signal.get_ydata())[steady])) == pytest.approx(height, rel=0.06)


def test_mean_deviation_is_centred_on_its_period() -> None:
    """A ramp's mean over a period is the ramp itself, at the period's middle."""
    estimate = estimated()
    pair = estimate.denoised[0]
    ramp = replace(estimate, denoised=(replace(pair, position_deviation_rad=pair.time_s.copy()),))
    picture = next(p for p in pictures(replace(bare(), estimate=ramp)) if p.name == "deviation")
    line = next(line for line in picture.figure.axes[0].lines if line.get_label() == "mean over one period")
    np.testing.assert_allclose(line.get_ydata(), 1e3 * np.asarray(line.get_xdata()), rtol=1e-9)


def test_command_falls_back_to_what_the_recording_has() -> None:
    """An import without demand, motion or added torque: position as measured, its slope, the sine."""
    run = replace(session().excited[0], position_demand_rad=None, motion=None)
    content = replace(bare(), session=replace(session(), runs=(run,)))
    figure = next(p for p in pictures(content) if p.name == "command").figure
    assert "no demand" in figure.axes[0].lines[0].get_label()
    np.testing.assert_allclose(figure.axes[1].lines[0].get_ydata(), run.speed_rad_s, atol=0.3)
    np.testing.assert_allclose(figure.axes[2].lines[0].get_ydata(), SINE.torque(run.time_s))


def test_peak_torque_is_drawn_where_the_torque_comes_near() -> None:
    run = session().excited[0]
    near = replace(run, torque_nm=run.torque_nm * 230 / np.max(np.abs(run.torque_nm)))
    content = replace(full(), estimate=None, contrast=None, session=replace(session(), runs=(near,)))
    texts = [t.get_text() for t in next(p for p in pictures(content) if p.name == "raw").figure.axes[1].texts]
    assert "peak torque" in texts


def test_thinning_keeps_every_peak_and_every_gap() -> None:
    rng = np.random.default_rng(3)
    x, y = np.arange(100_000.0), rng.normal(size=100_000)
    y[[777, 50_000]] = 99.0, -99.0
    y[20_000:30_000] = np.nan
    shown_x, shown_y = thin(x, y, 1000)
    assert shown_x.size <= 1000
    assert np.all(np.diff(shown_x) >= 0)
    assert np.nanmax(shown_y) == 99.0
    assert np.nanmin(shown_y) == -99.0
    assert np.isnan(shown_y).any()
    few_x, _ = thin(x[:1000], y[:1000], 1000)
    assert few_x.size == 1000


def test_the_users_own_matplotlib_settings_neither_matter_nor_change() -> None:
    with matplotlib.rc_context({"lines.linewidth": 30, "axes.facecolor": "black"}):
        picture = pictures(bare())[0]
        assert matplotlib.rcParams["axes.facecolor"] == "black"
    assert picture.figure.axes[0].get_facecolor() != (0, 0, 0, 1)


def test_figures_are_saved_in_reading_order(tmp_path: Path) -> None:
    paths = save_figures(bare(), tmp_path / "figures")
    assert [path.name for path in paths] == ["01_command.png", "02_raw.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file.*cannot be written"):
        save_figures(bare(), tmp_path / "file")
