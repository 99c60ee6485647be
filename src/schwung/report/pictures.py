"""Which pictures a report has, in reading order, and what to look for in each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from schwung.drivetrain.inertia import deviation
from schwung.errors import InputError
from schwung.estimation.values import Estimate
from schwung.report import figures
from schwung.report.content import ReportContent
from schwung.report.style import to_png
from schwung.session import Run

_VARIATION = (
    "The largest change is the MIV: {miv:.3g} {u.inertia}, {share:.0f} % of the mean. The limits were found on "
    "the machine of the published method and are carried over by the mean {u.inertia_word}."
)
_IMAGINARY = (
    " The imaginary part should stay near zero; where it does not, delay, friction or the believed stiffness "
    "is off."
)
_DEVIATION = (
    "The injected sine should move the axis by a sine and nothing else. A mean that wanders off zero while "
    "the axis moves says that it answered differently in the two runs: friction, play, or {u.torque_word} at its "
    "limit."
)
_COMMAND = "Shaded: the axis is asked to move. The injected sine fades in before the motion and out after it."
_RAW = (
    "As the drive reported it. The ripple is the injection and the machine's answer to it; apart from the "
    "ripple the two runs should lie on each other."
)
_DENOISED = (
    "The excited run minus the reference run. How large the speed's sine is for the {u.torque_word}'s, and how far it "
    "lags, depends on the load: that is what the {u.inertia_word} is computed from. Steady, clean sines are good; "
    "bursts show where the two runs were not alike."
)
_EXPORT = (
    "The same motion before and after the table was written into the drive. {gain} What is left, the "
    "feed-forward does not know: friction, elasticity and the error of the table itself."
)


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure with its place in the report: file-safe name, heading, and what to look for."""

    name: str
    title: str
    caption: str
    figure: Figure


def pictures(content: ReportContent) -> tuple[Picture, ...]:
    """Every picture for which the content has something to show; the inertia curve first."""
    return tuple(_pictures(content))


def save_figures(content: ReportContent, folder: Path) -> tuple[Path, ...]:
    """Write every picture as a PNG into the folder (made where missing); the files written.

    Raises InputError where the folder cannot be written.
    """
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for number, picture in enumerate(pictures(content), start=1):
            paths.append(folder / f"{number:02d}_{picture.name}.png")
            paths[-1].write_bytes(to_png(picture.figure))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(folder), f"cannot be written: {reason}", "Choose another place.") from None
    return tuple(paths)


def _pictures(content: ReportContent) -> Iterator[Picture]:
    estimate, units, run = content.estimate, content.units, content.shown_run
    if estimate is not None:
        yield Picture("inertia", f"The {units.inertia_word} curve", _inertia_caption(content, estimate),
                      figures.inertia_figure(content, estimate))  # fmt: skip
    if content.following_error is not None:
        caption = _EXPORT.format(gain=_gain(content.following_error.improvement))
        yield Picture("following_error", "What the export brought", caption,
                      figures.following_error_figure(content.following_error, units))  # fmt: skip
    if estimate is not None and estimate.traces:
        trust = estimate.trust
        caption = _VARIATION.format(miv=trust.miv_kgm2, u=units, share=100 * trust.relative_miv)
        caption += _IMAGINARY if figures.has_imaginary(estimate) else ""
        yield Picture("variation", "Is it steady?", caption, figures.variation_figure(content, estimate))
    pair = estimate.denoised[0] if estimate is not None and estimate.denoised else None
    if estimate is not None and pair is not None:
        yield Picture("deviation", "Is it linear?", _DEVIATION.format(u=units),
                      figures.deviation_figure(pair, estimate.frequency_hz, units))  # fmt: skip
    if run is not None:
        yield Picture("command", "What was commanded", _COMMAND if run.motion and run.excitation else "",
                      figures.command_figure(run, units))  # fmt: skip
        peak = content.machine.motor.peak_torque_nm if content.machine else None
        excited, plain = (pair.excited, pair.reference) if pair else _raw_pair(content, run)
        yield Picture("raw", "What was recorded", _RAW if plain else "",
                      figures.raw_figure(excited, plain, units, peak))  # fmt: skip
    if estimate is not None and pair is not None and estimate.traces:
        yield Picture("denoised", "What the injection alone has caused", _DENOISED.format(u=units),
                      figures.denoised_figure(pair, estimate.traces[0], units))  # fmt: skip


def _raw_pair(content: ReportContent, run: Run) -> tuple[Run, Run | None]:
    """A run and, where it is an excited one, the first reference to hold it against."""
    return run, next(iter(content.session.references), None) if run.role == "excited" else None


def _gain(times: float) -> str:
    if np.isinf(times):
        return "Nothing of the error is left."
    if times >= 1:
        return f"Its RMS is {times:.3g} times smaller."
    return f"Its RMS has grown {1 / times:.3g}-fold: do not keep this table."


def _inertia_caption(content: ReportContent, estimate: Estimate) -> str:
    text = "Thin lines are the single sweeps"
    text += ", the band is two standard deviations." if estimate.table.std_kgm2 is not None else "."
    if deviation(estimate.table, content.reference):
        text += f" Dashed: {content.reference_label}; below, the difference from it."
    if content.contrast is not None:
        text += f" For contrast, the {content.contrast.method} method on the same session"
        beyond = np.max(content.contrast.table.inertia_kgm2) > 1.2 * np.max(estimate.table.inertia_kgm2)
        text += ", which leaves the picture where it fails." if beyond else "."
    return text
