"""Which pictures a report has, in reading order, and what to look for in each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from schwung.report import curves, signals
from schwung.report.content import ReportContent
from schwung.report.style import to_png

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schwung.estimation import Estimate


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure with its place in the report: file-safe name, heading, and what to look for."""

    name: str
    title: str
    caption: str
    figure: Figure


def pictures(content: ReportContent) -> tuple[Picture, ...]:
    """Every picture for which the content has something to show; the inertia curve first."""
    drawn: list[Picture] = []
    estimate = content.estimate
    if estimate is not None:
        drawn.append(Picture("inertia", "The inertia curve", _inertia_caption(content, estimate),
                             curves.inertia_figure(content, estimate)))  # fmt: skip
    if content.following_error is not None:
        errors = content.following_error
        drawn.append(Picture(
            "following_error", "What the export brought",
            f"The same motion before and after the table was written into the drive: {_gain(errors.improvement)}. "
            "What is left at the end of each stroke is the controller's business, not the feed-forward's.",
            signals.following_error_figure(errors, content.units)))  # fmt: skip
    if estimate is not None:
        drawn.extend(_trust_pictures(content, estimate))
    if content.session.runs:
        drawn.extend(_recorded_pictures(content))
    if estimate is not None and estimate.denoised and estimate.traces:
        drawn.append(Picture(
            "denoised", "What the injection alone has caused",
            "The excited run minus the reference run. Where the load is heavy the speed answers with a smaller sine: "
            "the ratio of the two amplitudes, and their phase, is what the inertia is computed from. A steady, "
            "clean sine is good; bursts that do not belong to the sine are where the two runs were not alike.",
            signals.denoised_figure(content, estimate)))  # fmt: skip
    if any(row.max_s > 0 for row in content.sync):
        drawn.append(Picture(
            "sync", "SYNC on the bus",
            "How far SYNC came off its ideal grid, as received. Maxima beyond a tenth of the period are worth a "
            "look at adapter and bus load.",
            signals.sync_figure(content.sync)))  # fmt: skip
    return tuple(drawn)


def save_figures(content: ReportContent, folder: Path) -> tuple[Path, ...]:
    """Write every picture as a PNG into the folder (made where missing); the files written."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, picture in enumerate(pictures(content), start=1):
        path = folder / f"{number:02d}_{picture.name}.png"
        path.write_bytes(to_png(picture.figure))
        paths.append(path)
    return tuple(paths)


def _gain(times: float) -> str:
    if np.isinf(times):
        return "nothing of the error is left"
    if times >= 1:
        return f"its RMS is {times:.3g} times smaller"
    return f"its RMS has grown by a factor of {1 / times:.3g}; do not keep this table"


def _inertia_caption(content: ReportContent, estimate: Estimate) -> str:
    n = len(estimate.traces)
    sweeps = "the single sweep" if n == 1 else f"the {n} single sweeps"
    text = f"Thin lines are {sweeps}, the band is two standard deviations of the table."
    if content.reference is not None:
        text += f" The dashed line is the {content.reference_label}; below, the difference from it."
    if content.contrast is not None:
        text += (
            f" For contrast, the {content.contrast.method} method on the same session"
            + (", which leaves the picture where it fails." if _leaves(content, estimate) else ".")
        )  # fmt: skip
    return text


def _leaves(content: ReportContent, estimate: Estimate) -> bool:
    """Whether the contrast's curve goes beyond the axes of the inertia picture."""
    top = float(np.max(estimate.table.inertia_kgm2))
    return content.contrast is not None and float(np.max(content.contrast.table.inertia_kgm2)) > 1.2 * top


def _trust_pictures(content: ReportContent, estimate: Estimate) -> list[Picture]:
    drawn = [Picture(
        "variation", "Is it steady?",
        f"The largest value is the MIV: {estimate.trust.miv_kgm2:.3g} {content.units.inertia}, "
        f"{100 * estimate.trust.relative_miv:.0f} % of the mean. The limits were found on the machine of the "
        "published method; on a much lighter or heavier one go by the percentage. An imaginary part away from zero "
        "means that delay, friction or the believed stiffness is off.",
        curves.variation_figure(content, estimate))]  # fmt: skip
    if estimate.denoised:
        drawn.append(Picture(
            "deviation", "Is it linear?",
            "The injected sine should move the axis by a sine and nothing else. A mean that wanders off zero says "
            "that the machine answered differently in the two runs: friction, play, or torque at its limit.",
            signals.deviation_figure(content, estimate)))  # fmt: skip
    return drawn


def _recorded_pictures(content: ReportContent) -> list[Picture]:
    return [
        Picture("command", "What was commanded",
                "Shaded: the axis is asked to move. The injected sine fades in before the motion and out after it.",
                signals.command_figure(content)),
        Picture("raw", "What was recorded",
                "As the drive reported it. The ripple is the injection and the machine's answer; beyond it the two "
                "runs should lie on each other.",
                signals.raw_figure(content)),
    ]  # fmt: skip
