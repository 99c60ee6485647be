"""Hide an effect on a machine: a random shape, and the size that gives the strength wished for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from schwung_sim.errors import BenchError
from schwung_sim.plants.concealed import Concealed
from schwung_sim.plants.two_mass import TwoMassPlant
from schwung_sim.sealed.foreign import FOREIGN_NAMES, Likeness, draw_foreign
from schwung_sim.sealed.machines import Chance, DrawnMachine
from schwung_sim.sealed.shapes import Parameters, Shape, draw_shape
from schwung_sim.sealed.strength import (
    PlayedRun,
    play_runs,
    representative_runs,
    residual_rms,
    residuals,
    size_for,
    strength,
)

#: Effects of which a few runs are not representative: they are measured on all.
_UNEVEN = ("friction_drift", "torque_saturation")


@dataclass(frozen=True)
class HiddenEffect:
    """An effect that a session hides, and its strength alone.

    A foreign one has a likeness, the named effect that it is most like; its strength is what it changes beyond that.
    """

    physics: str
    parameters: Parameters
    strength: float
    likeness: str = ""


def make_plant(drawn: DrawnMachine, effects: Mapping[str, Parameters], seed: int) -> TwoMassPlant:
    """The machine with these effects, named and foreign."""
    named = {name: dict(values) for name, values in effects.items() if name not in FOREIGN_NAMES}
    foreign = {
        name: {key: float(value) for key, value in values.items() if isinstance(value, float)}
        for name, values in effects.items()
        if name in FOREIGN_NAMES
    }
    return TwoMassPlant(drawn.drive, drawn.profile, Concealed(named), seed, foreign)


def hide(
    seed: int, chance: Chance, drawn: DrawnMachine, name: str, target_nm: float, silent: Sequence[PlayedRun]
) -> HiddenEffect | None:
    """An effect of a random shape, as strong as wished (N·m rms); None where this machine cannot have it.

    `silent` are the session's runs with nothing hidden.
    """
    indices = list(range(len(drawn.runs))) if name in _UNEVEN else representative_runs(drawn)
    if name in FOREIGN_NAMES:
        return _hide_foreign(seed, draw_foreign(chance, drawn, name), drawn, target_nm, indices)
    peak = max(float(np.max(np.abs(run.rows[:, 2]))) for run in silent)
    shape = draw_shape(chance, drawn, name, peak)
    if shape is None:
        return None
    silent_nm = residual_rms(drawn, [silent[i] for i in indices])
    measure = _measure(seed, shape, drawn, indices, lambda played: strength(drawn, played, silent_nm))
    size = size_for(measure, target_nm, shape.highest)
    return None if size is None else HiddenEffect(name, shape.at(size), measure(size))


def _hide_foreign(
    seed: int, shape: Shape, drawn: DrawnMachine, target_nm: float, indices: list[int]
) -> HiddenEffect | None:
    likeness = Likeness(drawn, seed, indices)
    measure = _measure(
        seed, shape, drawn, indices, lambda played: likeness.beyond(residuals(drawn, played))[0]
    )
    size = size_for(measure, target_nm, shape.highest)
    if size is None:
        return None
    plant = make_plant(drawn, {shape.name: shape.at(size)}, seed)
    beyond, alike = likeness.beyond(residuals(drawn, play_runs(drawn, plant, seed, indices)))
    return HiddenEffect(shape.name, shape.at(size), beyond, alike)


def _measure(
    seed: int,
    shape: Shape,
    drawn: DrawnMachine,
    indices: list[int],
    judge: Callable[[list[PlayedRun]], float],
) -> Callable[[float], float]:
    """Strength (N·m rms) over size; infinite where the machine no longer stands it."""

    def measure(size: float) -> float:
        plant = make_plant(drawn, {shape.name: shape.at(size)}, seed)
        try:
            return judge(play_runs(drawn, plant, seed, indices))
        except BenchError:
            return float("inf")

    return measure
