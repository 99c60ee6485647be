"""A sealed case: drawn from a seed, recorded, written as session and belief; its label apart, for the scorer alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from schwung_sim.errors import BenchError
from schwung_sim.plants import TICK_S
from schwung_sim.plants.two_mass import TwoMassPlant
from schwung_sim.sealed.files import Belief, RecordedRun, write_belief, write_session
from schwung_sim.sealed.foreign import FOREIGN_NAMES, Likeness
from schwung_sim.sealed.hiding import HiddenEffect, hide, make_plant
from schwung_sim.sealed.machines import Chance, DrawnMachine, draw_machine
from schwung_sim.sealed.shapes import EXCLUSIVE, NAMES
from schwung_sim.sealed.strength import (
    PlayedRun,
    floor_nm,
    in_band,
    play_runs,
    residual_rms,
    residuals,
    strength,
)

Array = NDArray[np.float64]
Kind = Literal["none", "single", "two", "three", "foreign"]
Level = Literal["weak", "clear", "gross"]
ControlBelief = Literal["given", "none", "wrong"]

#: Residual over the noise floor, drawn evenly in the logarithm.
LEVELS: Mapping[Level, tuple[float, float]] = {
    "weak": (3.0, 3.0),
    "clear": (8.0, 30.0),
    "gross": (30.0, 100.0),
}
#: The label file, in a folder of its own beside the sessions.
LABELS = "sealed/labels.jsonl"
_HIDDEN: Mapping[Kind, int] = {"none": 0, "single": 1, "two": 2, "three": 3, "foreign": 1}
_ATTEMPTS = 60


@dataclass(frozen=True)
class CaseWishes:
    """What to draw: how many effects, from which names (none: all), how strong, and which gains are believed."""

    kind: Kind = "single"
    level: Level = "clear"
    among: tuple[str, ...] = ()
    control: ControlBelief = "given"

    @property
    def names(self) -> tuple[str, ...]:
        """`among`, or all there are of this kind."""
        return self.among or (FOREIGN_NAMES if self.kind == "foreign" else NAMES)


@dataclass(frozen=True, eq=False)
class SealedCase:
    """A machine, what it hides, and what its session recorded."""

    seed: int
    wishes: CaseWishes
    drawn: DrawnMachine
    effects: tuple[HiddenEffect, ...]
    floor_nm: float
    strength: float  # of everything hidden, over all runs
    played: tuple[PlayedRun, ...]

    def label(self, case: str) -> dict[str, Any]:
        """What only the scorer may know."""
        return {
            "case": case,
            "seed": self.seed,
            "kind": self.wishes.kind,
            "level": self.wishes.level,
            "among": list(self.wishes.among),
            "control": self.wishes.control,
            "floor_nm": self.floor_nm,
            "strength": self.strength,
            "effects": [
                {
                    "physics": effect.physics,
                    "parameters": dict(effect.parameters),
                    "strength": effect.strength,
                    "likeness": effect.likeness,
                }
                for effect in self.effects
            ],
            "covered": _covered(self.drawn, self.played),
            "machine": {
                "profile": self.drawn.profile_kind,
                "rate_hz": self.drawn.rate_hz,
                "distance_rad": self.drawn.distance_rad,
                "runs": len(self.drawn.runs),
                "mean_inertia_kgm2": float(np.mean(self.drawn.profile.at(self.drawn.angles_rad()))),
            },
        }


def draw_case(seed: int, wishes: CaseWishes) -> SealedCase:
    """The case of this seed; machines on which the wished effects cannot be that strong are drawn again.

    Raises BenchError for names that do not exist, and where no machine is found.
    """
    known = FOREIGN_NAMES if wishes.kind == "foreign" else NAMES
    if unknown := sorted(set(wishes.names) - set(known)):
        raise BenchError("sealed case", f"hides no {', '.join(unknown)}", f"There are {', '.join(known)}.")
    names = _choose(seed, wishes)
    for attempt in range(_ATTEMPTS):
        made = _attempt(seed, np.random.default_rng([seed, attempt, 71]), names, wishes)
        if made is not None:
            return made
    raise BenchError("sealed case", f"found no machine for {', '.join(names)} in {_ATTEMPTS} draws")


def _choose(seed: int, wishes: CaseWishes) -> tuple[str, ...]:
    """Names to hide: successive seeds go through all of them before one comes again, in a shuffled order."""
    count = _HIDDEN[wishes.kind]
    if count == 0:
        return ()
    among = wishes.names
    block, place = divmod(seed, len(among))
    names = [among[np.random.default_rng([block, 3]).permutation(len(among))[place]]]
    others = [among[i] for i in np.random.default_rng([seed, 5]).permutation(len(among))]
    for name in others:
        if len(names) < count and name not in names and not any(
            name in group and not group.isdisjoint(names) for group in EXCLUSIVE
        ):  # fmt: skip
            names.append(name)
    if len(names) < count:
        raise BenchError("sealed case", f"{count} of {', '.join(among)} do not go together")
    return tuple(names)


def _attempt(seed: int, chance: Chance, names: tuple[str, ...], wishes: CaseWishes) -> SealedCase | None:
    drawn = draw_machine(chance)
    floor = floor_nm(drawn)
    low, high = np.log(LEVELS[wishes.level])
    plain = TwoMassPlant(drawn.drive, drawn.profile, seed=seed)
    silent = play_runs(drawn, plain, seed)
    effects: list[HiddenEffect] = []
    for name in names:
        target = float(np.exp(chance.uniform(low, high)))
        hidden = hide(seed, chance, drawn, name, target * floor, silent)
        if hidden is None:
            return None
        effects.append(replace(hidden, strength=hidden.strength / floor))
    try:
        played = play_runs(drawn, make_plant(drawn, {e.physics: e.parameters for e in effects}, seed), seed)
    except BenchError:
        return None
    highest = max(float(np.max(np.abs(run.rows[:, 2]))) for run in played)
    if highest > 0.97 * drawn.drive.peak_torque_nm:
        return None  # the drive's own limit would be a further effect
    total = strength(drawn, played, residual_rms(drawn, silent)) / floor
    return SealedCase(seed, wishes, drawn, tuple(effects), floor, total, tuple(played))


def likeness_of(case: SealedCase) -> tuple[float, str]:
    """Of a case with one effect: its strength beyond the other named effect that it is most like, and that one's name.

    Where hardly anything is beyond, the torque residual does not tell the two apart (reported speed against reported
    angle may: that is how a measurement delay differs from a torque lag).
    """
    drawn, name = case.drawn, case.effects[0].physics
    likeness = Likeness(drawn, case.seed, list(range(len(drawn.runs))), without=name)
    beyond, alike = likeness.beyond(residuals(drawn, case.played))
    return beyond / case.floor_nm, alike


def _covered(drawn: DrawnMachine, played: tuple[PlayedRun, ...]) -> dict[str, list[float]]:
    """The range of every coordinate that the session's strokes cover, within the band of the residuals."""
    smooth = [in_band(run.rows) for run in played]
    during = [drawn.runs[run.index].stroke.moving() for run in played]
    position, speed, torque = (
        np.concatenate([rows[moving, i] for rows, moving in zip(smooth, during, strict=True)])
        for i in range(3)
    )
    acceleration = np.concatenate(
        [np.gradient(rows[:, 1], TICK_S)[moving] for rows, moving in zip(smooth, during, strict=True)]
    )
    ranges = {"position": position, "speed": speed, "torque": torque, "acceleration": acceleration}
    longest = max(run.stroke.total_s - run.stroke.start_time_s - run.stroke.dwell_s for run in drawn.runs)
    return {
        **{name: [float(np.min(values)), float(np.max(values))] for name, values in ranges.items()},
        "direction": [-1.0, 1.0],
        "time_in_motion": [0.0, longest],
        "run": [0.0, float(len(drawn.runs) - 1)],
        "frequency": [0.0, 200.0],
    }


def write_case(case: SealedCase, out: Path, name: str) -> None:
    """Write OUT/sessions/NAME/ (session.h5, machine.toml, tables) and add the label to OUT/sealed/labels.jsonl."""
    folder = out / "sessions" / name
    folder.mkdir(parents=True, exist_ok=True)
    write_session(folder / "session.h5", _recorded(case), case.drawn.rate_hz)
    write_belief(folder, _belief(case, name))
    labels = out / LABELS
    labels.parent.mkdir(parents=True, exist_ok=True)
    with labels.open("a", encoding="utf-8") as file:
        file.write(json.dumps(case.label(name)) + "\n")


def read_labels(out: Path) -> list[dict[str, Any]]:
    """Open the seal: every label. For the scoring step only."""
    lines = (out / LABELS).read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]


def _recorded(case: SealedCase) -> list[RecordedRun]:
    """What was reported: every so many ticks, with noise."""
    drawn = case.drawn
    every = round(1 / (drawn.rate_hz * TICK_S))
    chance = np.random.default_rng([case.seed, 29])
    scales = (0.0, drawn.noise.speed_rad_s, drawn.noise.torque_nm)  # the encoder's own has been in the loop
    recorded = []
    for run in case.played:
        plan = drawn.runs[run.index]
        rows = run.rows[::every]
        noisy = rows + chance.standard_normal(rows.shape) * scales
        recorded.append(
            RecordedRun(
                role="excited" if plan.injection else "reference",
                repeat=plan.repeat,
                motion=plan.stroke.json(),
                excitation=plan.injection.json() if plan.injection else None,
                position_rad=noisy[:, 0],
                speed_rad_s=noisy[:, 1],
                torque_nm=noisy[:, 2],
                position_demand_rad=plan.stroke.demand_rad()[::every],
                torque_added_nm=plan.torque_added_nm()[::every],
            )
        )
    return recorded


def _belief(case: SealedCase, name: str) -> Belief:
    """The machine as it is but for what it hides; gains as they are, not given, or wrong by 1.3 to 2 either way."""
    drawn, chance = case.drawn, np.random.default_rng([case.seed, 31])
    settings = drawn.settings
    control = {
        "position_gain": settings.position_gain_1_s,
        "speed_gain": settings.speed_gain_nms_rad,
        "speed_integral_time": settings.speed_integral_time_s,
    }
    if case.wishes.control == "wrong":
        for key in control:
            control[key] *= float(np.exp(chance.choice([-1, 1]) * chance.uniform(np.log(1.3), np.log(2.0))))
    margin = 0.5
    angles = drawn.angles_rad()
    wide = np.linspace(angles[0] - margin, angles[-1] + margin, 2 + int((angles[-1] - angles[0] + 1) / 0.01))
    return Belief(
        name=f"Machine {name}",
        drive=drawn.drive,
        control=None if case.wishes.control == "none" else {**control, "sample_rate": 1 / TICK_S},
        position_rad=wide,
        inertia_kgm2=drawn.profile.at(wide),
        constant=drawn.profile_kind == "constant",
    )
