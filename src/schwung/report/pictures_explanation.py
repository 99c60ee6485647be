"""Pictures that explanations share: each named term over its own coordinate, and what a mismatch follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from matplotlib.figure import Figure

from schwung.drivetrain.machine import Machine
from schwung.explain.values import Located, Overlay
from schwung.explain.words import View, words_of
from schwung.report.content import Units
from schwung.report.explanation_terms import Term, coupling_figure, term_figure
from schwung.report.figures_explanation import located_figure
from schwung.report.pictures import Picture
from schwung.report.wording import listed, place_of

_DRAWN: dict[View, str] = {
    "speed": "over speed",
    "position": "over {u.position_word}",
    "torque": "over {u.torque_word}",
    "torque_rate": "over the rate of change of the {u.torque_word}: the line's slope is the time",
    "acceleration": "over acceleration",
    "time": "over time",
    "frequency": "over frequency",
    "run": "over the session",
    "wind_up": "over the coupling's wind-up",
}
_DOTS = (
    "Dots: the measured {u.torque_word} minus everything that the model needs without this term, in all recorded "
    "runs. Green: the term as fitted. "
)
_SPECTRUM = "Orange: what the model leaves without this term; green: with it. "
_DRIFT = "Dots: the mean of what acts against the motion in each run; green: the term as fitted. "
_WIND_UP = "Grey: what the coupling had to carry in the recorded runs; beyond it nothing was seen. "
MAP = (
    "Orange: the machine needed more than the model knows; blue: less; the stronger, the more. "
    "Empty: the axis was not there."
)


def located_pictures(mismatch: Sequence[Located], remainder: Sequence[Located]) -> Iterator[Picture]:
    """Which coordinates the mismatch follows, and what is left of it."""
    for name, title, located in (
        ("located", "What the mismatch follows", mismatch),
        ("remainder", "What is left", remainder),
    ):
        if located:
            caption = (
                "Share of its energy that follows from each coordinate. What several could predict is credited to "
                "the simplest; one that this session cannot tell from another is listed with it. Grey: may be chance."
            )
            places = [place_of(where) for where in located]
            yield Picture(name, title, caption, located_figure(located, places, "Share of the energy, %"))


def named_pictures(
    terms: Sequence[Term], runs: Sequence[Overlay], believed: Machine, units: Units
) -> Iterator[Picture]:
    """Each named term over its own coordinate; all that was named of the coupling's law in one picture."""
    for number, term in enumerate(terms):
        figure = term_figure(term, runs, units)
        if figure is not None:
            yield _term_picture(units, f"term{number}", [term], figure)
    law = [term for term in terms if words_of(term.physics).view == "wind_up"]
    figure = coupling_figure(law, runs, believed, units) if law else None
    if figure is not None:
        yield _term_picture(units, "coupling", law, figure)


def _term_picture(units: Units, name: str, terms: Sequence[Term], figure: Figure) -> Picture:
    words = [words_of(term.physics, linear=units.position == "m") for term in terms]
    where, _, slope = _DRAWN[words[0].view].format(u=units).partition(": ")
    called = listed([each.name for each in words])
    own = {"wind_up": _WIND_UP, "frequency": _SPECTRUM, "run": _DRIFT}
    caption = own.get(words[0].view, _DOTS.format(u=units))
    caption += f" {slope.capitalize()}." if slope else ""
    return Picture(name, f"{called[:1].upper()}{called[1:]}, {where}", caption, figure)
