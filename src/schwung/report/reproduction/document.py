"""Which figures and tables there are, and the document that shows them beside what the paper reports."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from schwung.errors import InputError
from schwung.files import replace_file
from schwung.report.reproduction import filters, motion_times, standstill, validation
from schwung.report.reproduction.experiments import TABLE_POINTS
from schwung.report.reproduction.layout import Reproduced
from schwung.report.style import to_png

DPI = 110
COLOURS = 200

MAKERS: dict[str, Callable[[], Reproduced]] = {
    "figure-4": filters.figure_4,
    "figure-5": filters.figure_5,
    "figure-6": filters.figure_6,
    "gdft": motion_times.generalised,
    "figure-9": motion_times.figure_9,
    "figure-10": motion_times.figure_10,
    "figure-12": standstill.figure_12,
    "figure-13": validation.figure_13,
    "figure-14": validation.figure_14,
    "table-2": validation.table_2,
}

PREAMBLE = """\
# The paper, reproduced

Ceulemans, Vanbecelaere, Van Oosterwyck, De Viaene, Derammelaere et al., "Online tracking of dynamically time-varying
inertia using an enhanced SDFT-based estimation methodology", Discover Mechanical Engineering 3:7 (2024),
[doi 10.1007/s44245-024-00036-9](https://doi.org/10.1007/s44245-024-00036-9). This page was written by
`schwung reproduce {asked} --out {out}`, from simulations alone; nothing in it is copied from the paper but its numbers.

- **Machine**: Table 1 of the paper. Its load inertia over angle and load torque are only drawn there (Fig. 8); ours is
  *inferred*, a slider-crank J_l = 0.055 + 0.105 (sin θ + λ sin θ cos θ / √(1 − λ² sin² θ))² kg·m², λ = 0.25, over a
  stroke of π, without load torque. "True" below means this curve. The paper's Figures 12 to 14 and Table 2 are
  measurements on a machine; here they are simulations, too.
- **Recording**: 8 kHz (125 µs, which the paper prints as ms), noise of 0.02 rad/s and 0.1 N·m (standard deviations),
  one stroke without and one with injection, 1/3 profile unless said otherwise. Control: K_pp 60 1/s,
  K_ps 7 N·m·s/rad, T_n 8 ms, no feed-forward.
- **Estimate**: the paper's magnitude inversion with equation (6) put right; errors are estimate minus truth at
  equally spaced angles of the stroke ({points} points over all that was visited).
"""


@dataclass(frozen=True)
class Written:
    """What was made: the document, its pictures, and the two lines about each."""

    document: Path
    pictures: tuple[Path, ...]
    lines: dict[str, dict[str, str]]  # name -> title, paper, here, difference


def names_of(asked: Sequence[str]) -> tuple[str, ...]:
    """Names in the paper's order: "all", "9", "figure-9", "figure 9", "table-2" or "table2".

    Raises InputError that lists what there is.
    """
    wanted = set()
    for word in asked or ["all"]:
        plain = word.lower().replace("figure", "").replace("fig.", "").replace("fig", "").strip(" -_")
        if plain == "all":
            return tuple(MAKERS)
        name = f"table-{plain[5:].strip(' -_')}" if plain.startswith("table") else f"figure-{plain}"
        name = plain if plain in MAKERS else name
        if name not in MAKERS:
            raise InputError(word, "is no figure or table that can be reproduced",
                             f"Choose among {', '.join(MAKERS)}, all.")  # fmt: skip
        wanted.add(name)
    return tuple(name for name in MAKERS if name in wanted)


def reproduce(
    asked: Sequence[str], folder: Path, tell: Callable[[str, Reproduced], None] | None = None
) -> Written:
    """Make what was asked for: `folder`/reproduction.md and `folder`/reproduction/*.png.

    `tell` hears of each as it is done. Raises InputError for a name that there is not, and where `folder` cannot be
    written.
    """
    names = names_of(asked)
    pictures, lines = [], {}
    parts = [PREAMBLE.format(asked=" ".join(asked) or "all", out=folder.name or folder, points=TABLE_POINTS)]
    try:
        (folder / "reproduction").mkdir(parents=True, exist_ok=True)
        for name in names:
            made = MAKERS[name]()
            if made.figure is not None:
                pictures.append(folder / "reproduction" / f"{name}.png")
                pictures[-1].write_bytes(_small(to_png(made.figure, DPI)))
            parts.append(_section(name, made))
            lines[name] = {"title": made.title, "paper": made.paper, "here": made.here}
            lines[name]["difference"] = made.difference
            if tell is not None:
                tell(name, made)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(folder), f"cannot be written: {reason}", "Choose another place.") from None
    document = folder / "reproduction.md"
    replace_file(document, "\n".join(parts))
    return Written(document, tuple(pictures), lines)


def _section(name: str, made: Reproduced) -> str:
    shown = made.table if made.figure is None else f"![{made.title}](reproduction/{name}.png)"
    return (
        f"## {made.title}\n\n{shown}\n\n**Paper**: {made.paper}\n\n**Here**: {made.here}\n\n"
        f"**Difference**: {made.difference}\n"
    )


def _small(png: bytes) -> bytes:
    """The same picture with a palette of its own: a third of the size, and no difference to the eye."""
    out = io.BytesIO()
    with Image.open(io.BytesIO(png)) as picture:
        reduced = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
        reduced.save(out, "PNG", optimize=True)
    return out.getvalue()
