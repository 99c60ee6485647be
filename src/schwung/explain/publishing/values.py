"""What people get, as values: names, curves, the proof, and the document of explanation.json."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from schwung.drivetrain.effects import PHYSICS
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.residual_plane import Plane
from schwung.explain.publishing.drawn import Drawn
from schwung.explain.values import Located, Overlay, Quantity, Verdict
from schwung.explain.weighing.values import NAMED, Lasting, Timing
from schwung.explain.words import unit_on, words_of
from schwung.innovations.likelihood import Noise
from schwung.quantities import Effort
from schwung.session.model import Axis

#: Innovations below so many times the noise's show nothing.
_FLOOR = 1.02
#: Innovations so many times the noise's miss as much again as the noise: that is plain, whatever was found.
PLAIN = 2**0.5
#: Of what runs show beyond noise: so much may be left where it is explained, and where it is in part.
LITTLE, _MUCH = 0.05, 0.5
#: Beyond it a probability is told as more than 99 %.
_ALL = 0.99


def percent(p: float) -> str:
    """A probability in words: whole per cents, but never quite all or nothing."""
    return "> 99 %" if p > _ALL else "< 1 %" if p < 1 - _ALL else f"{100 * p:.0f} %"


#: A set of causes that is less probable is no rival.
_RIVAL = 0.05
#: Sets of causes that are less probable are not told, nor more than so many.
_TOLD, _MOST = 0.01, 6


def merged(shares: Iterable[tuple[Sequence[str], float]]) -> tuple[tuple[tuple[str, ...], float], ...]:
    """Sets with their probabilities, those of the same names as one, the most probable first.

    A name may stand for several shapes: of a cogging of another order, people need one line.
    """
    every: dict[tuple[str, ...], float] = {}
    for names, share in shares:
        key = tuple(sorted(set(names)))
        every[key] = every.get(key, 0.0) + share
    told = sorted(every.items(), key=lambda one: -one[1])
    return tuple((names, min(share, 1.0)) for names, share in told if share >= _TOLD)[:_MOST]


@dataclass(frozen=True)
class Proof:
    """On motions that were not fitted, with the coefficients that are published."""

    runs: tuple[int, ...]
    gain: float  # of the log predictive likelihood over the belief's, per effective sample
    before: float  # root mean square of the innovations over the noise's: of the belief, of what is published
    after: float
    before_nm: float | None = None  # torque that is missed, smoothed, root mean square; None: not worked out
    after_nm: float | None = None
    fitted: tuple[int, ...] = ()  # the runs that all was fitted on

    @property
    def taken(self) -> float:
        """Share of what the belief misses beyond the noise (variance) that is missed no longer.

        Where it misses nothing beyond noise there is nothing to take: 1, or 0 where something is missed since.
        """
        beyond, since = self.before**2 - 1, max(self.after**2 - 1, 0.0)
        if beyond <= 0:
            return 0.0 if since else 1.0
        return min(1.0, 1 - since / beyond)


@dataclass(frozen=True)
class Where:
    """Where a cause acts: over its coordinate, between which values, the axis moving which way."""

    coordinate: str
    interval: tuple[float, float] | None  # None: wherever the axis was
    unit: str
    way: str  # "forward" or "backward" where it acts in that direction alone
    share: (
        float | None
    )  # of what the belief misses (mean square), 0…1; None: it acts between the shafts, of no whole

    @property
    def text(self) -> str:
        """'at 1.2 … 1.6 rad, while moving forward'; empty: wherever the axis was."""
        place = ""
        if self.interval is not None:
            low, high = (f"{end:.3g}".replace("-", "−") for end in self.interval)
            told = "" if self.coordinate == "position" else f" of {over_words(self.coordinate)}"
            place = f"at {low} … {high} {self.unit}{told}"
        return ", ".join(part for part in (place, self.way and f"while moving {self.way}") if part)

    def to_json(self) -> dict[str, Any]:
        """For explanation.json."""
        return {
            "coordinate": self.coordinate,
            "interval": None if self.interval is None else list(self.interval),
            "unit": self.unit,
            "direction": self.way or None,
            "share_of_energy": self.share,
        }


@dataclass(frozen=True, eq=False)
class Name:
    """A physics name, its probability, and its parameters with 95 % intervals."""

    physics: str
    probability: float
    parameters: Mapping[str, Quantity]
    in_file: bool  # by this name
    formula: str = ""  # of a curve, as good as it on runs that were not fitted
    where: Where | None = None  # None: not published, or of what is reported alone
    each_run: bool = False  # every run has its own, which no file foresees


@dataclass(frozen=True, eq=False)
class Curve:
    """What is modelled without a name: over which coordinate, how large, and the curve, where it can be drawn."""

    coordinate: str
    unit: str
    probability: float
    torque_nm: float  # root mean square along the runs
    like: str  # the name whose law it follows without being surely it; empty: a curve of its own
    in_file: bool
    drawn: Drawn | None = None
    formula: str = ""  # as good as the curve on runs that were not fitted
    formula_missed: float | None = None  # there, over the noise
    plane: Plane | None = None  # over two coordinates at once
    where: Where | None = None

    @property
    def over(self) -> str:
        """The coordinate in words."""
        return over_words(self.coordinate)


@dataclass(frozen=True, eq=False)
class Plain:
    """Laws that come near to all that has no name, by least squares, and the share of it that they take."""

    laws: Mapping[str, Mapping[str, Quantity]]
    share: float  # mean square, 0…1


def _like(one: Curve, *, linear: bool) -> str:
    """Which law a curve follows without being surely it: several may be over one coordinate."""
    return f", like {words_of(one.like, linear=linear).name}," if one.like else ""


def over_words(coordinate: str) -> str:
    """What a curve is over."""
    told = coordinate.replace("travel", "the way since a reversal").replace(
        "wind_up", "the coupling's wind-up"
    )
    return told.replace("_", " ").replace(", ", " and ")


@dataclass(frozen=True, eq=False)
class Published:
    """The answer as it is published. `runners_up`: sets of names with probabilities, the most probable first, each
    once; the published one among them. `overlays`: runs for pictures, those kept aside first. `mismatch`,
    `remainder`: which coordinates the torque follows that the belief, that the file misses on the fitted runs."""

    axis: Axis
    effort: Effort
    names: tuple[Name, ...]
    curves: tuple[Curve, ...]
    runners_up: tuple[tuple[tuple[str, ...], float], ...]
    noise: Noise
    excess: float
    timing: Timing
    proof: Proof | None
    overlays: tuple[Overlay, ...]
    machine: Machine
    notes: tuple[str, ...]
    mismatch: tuple[Located, ...] = ()
    remainder: tuple[Located, ...] = ()
    plain: Plain | None = None
    lasting: Lasting | None = None
    missed_runs: tuple[tuple[int, float], ...] = ()  # fitted runs that the file plainly misses, and how (σ)

    @property
    def in_file(self) -> tuple[str, ...]:
        """The set of causes that is published, as `runners_up` has it."""
        named = {one.physics for one in self.names if one.in_file}
        return tuple(sorted(named | {one.like or one.coordinate for one in self.curves if one.in_file}))

    @property
    def confused(self) -> tuple[tuple[str, str], ...]:
        """Names of the published set, each with one that another set, not much less probable, has in its place."""
        pairs: dict[frozenset[str], tuple[str, str]] = {}
        for names, p in self.runners_up:
            if names != self.in_file and p >= _RIVAL:
                ours, others = ([name for name in one if name in PHYSICS] for one in (self.in_file, names))
                for one in (name for name in ours if name not in others):
                    for other in (name for name in others if name not in ours):
                        pairs.setdefault(frozenset((one, other)), (one, other))
        return tuple(pairs.values())

    @property
    def verdict(self) -> Verdict:
        """By what the file takes of what runs kept aside show beyond noise; and by whether repeats differ by more, and
        whether a run that was fitted shows what those kept aside do not."""
        found, left = bool(self.in_file), self.left
        if not found:
            missed = self.proof is not None and self.proof.after > _FLOOR
            return "unexplained" if missed or self.lasting or self.missed_runs else "consistent"
        if self.proof is None or left is None:
            return "partly_explained"
        if left <= LITTLE:
            return "partly_explained" if self.missed_runs else "explained"
        missed = self.proof.after > PLAIN and left > _MUCH and not self._each_run
        return "unexplained" if missed else "partly_explained"

    @property
    def headline(self) -> str:
        """In one sentence."""
        linear = self.axis == "linear"
        likely = [
            f"{words_of(one.physics, linear=linear).name} ({percent(one.probability)}{_at(one.where)})"
            for one in self.names
            if one.in_file
        ]
        force = "force" if linear else "torque"
        curves = [
            f"a {force} over {one.over}{_like(one, linear=linear)} without a name "
            f"({percent(one.probability)}{_at(one.where)})"
            for one in self.curves
            if one.probability > NAMED
        ]
        formulated = all(one.formula for one in self.curves if one.in_file)
        what = ", ".join([*likely, *curves]) + ("" if formulated or not curves else self._plainly)
        what = what or self._one_of
        if not what and self.verdict == "unexplained":
            missed = (
                [f"the belief misses {self._missed()}"] if self.proof and self.proof.after > _FLOOR else []
            )
            parts = [*missed, *self._lasting, *(self._in_fitted if not missed else [])]
            return f"unexplained: {', '.join(parts)}, and nothing was found that takes it"
        if not what:
            return "the belief leaves out nothing that this session tells from noise"
        if self.proof is None:
            return f"left out: {what}; no run could be kept aside to prove it"
        if self.proof.before > _FLOOR and self.proof.taken <= 0 and self._each_run:
            return f"left out: {what}; every run has its own of it, so that no file foresees {self._kept_aside()}"
        if self.proof.before > _FLOOR and self.proof.taken <= 0:
            return f"unexplained: the belief misses {self._missed()}, and what was found takes nothing of it: {what}"
        return f"left out: {what}; {self._share()}"

    @property
    def _each_run(self) -> bool:
        """Whether something is published of which every run has its own."""
        return any(one.in_file and one.each_run for one in self.names)

    @property
    def _one_of(self) -> str:
        """Where something is in the file, and several names stand for it of which none is likelier than not."""
        if not self.in_file:
            return ""
        linear = self.axis == "linear"
        likely = sorted(
            (one for one in self.names if one.probability >= _RIVAL), key=lambda one: -one.probability
        )
        each = [f"{words_of(one.physics, linear=linear).name} ({percent(one.probability)})" for one in likely]
        return (
            f"one of {', '.join(each)}"
            if each
            else "something that no name and no coordinate is likely to be"
        )

    @property
    def _plainly(self) -> str:
        """What comes near to that which has no name."""
        if self.plain is None:
            return ""
        linear = self.axis == "linear"
        laws = " and ".join(words_of(name, linear=linear).name for name in self.plain.laws)
        return f", together {percent(self.plain.share)} like {laws}"

    @property
    def _lasting(self) -> list[str]:
        if self.lasting is None:
            return []
        unit, times = unit_on("N·m", self.axis), self.lasting.over_noise
        size = f"{self.lasting.torque_nm:.2g} {unit}, {times:.2g} times what is noise"
        return [f"repeats of a motion differ by {size}, from one run to the next"]

    @property
    def _in_fitted(self) -> list[str]:
        """Of what runs that were fitted show alone."""
        if not self.missed_runs:
            return []
        runs = ", ".join(str(run) for run, _ in self.missed_runs)
        most = max(missed for _, missed in self.missed_runs)
        return [
            f"the belief misses up to {most:.3g} σ of the noise on run{'s' * (len(self.missed_runs) > 1)} {runs}"
        ]

    def _missed(self) -> str:
        assert self.proof is not None
        return f"{self.proof.before:.3g} σ of the noise on {self._kept_aside()}"

    def _kept_aside(self) -> str:
        runs = self.proof.runs if self.proof is not None else ()
        return f"run{'s' * (len(runs) > 1)} {', '.join(map(str, runs))}"

    def _share(self) -> str:
        assert self.proof is not None
        runs = self._kept_aside()
        shows = "show" if len(self.proof.runs) > 1 else "shows"
        if self.proof.before <= _FLOOR:
            return f"{runs}, kept aside, {shows} nothing of it"
        return f"that takes {100 * max(self.proof.taken, 0.0):.0f} % of what {runs}, kept aside, {shows} beyond noise"

    @property
    def left(self) -> float | None:
        """What runs kept aside show beyond noise and nothing explains (share of the variance); None: unknown."""
        return None if self.proof is None else 1 - self.proof.taken

    def to_json(self) -> dict[str, Any]:
        """The document of explanation.json."""
        return {
            "format": "schwung-explanation",
            "version": 2,
            "verdict": self.verdict,
            "headline": self.headline,
            "names": [
                {
                    "physics": one.physics,
                    "probability": one.probability,
                    "in_file": one.in_file,
                    "formula": one.formula or None,
                    "where": one.where and one.where.to_json(),
                    "parameters": {
                        key: {"value": q.value, "unit": q.unit, "ci95": q.ci95}
                        for key, q in one.parameters.items()
                    },
                    "indistinguishable_from": [other for name, other in self.confused if name == one.physics],
                }
                for one in self.names
            ],
            "unnamed": [_curve_json(one) for one in self.curves],
            "plain": self.plain
            and {
                "share": self.plain.share,
                "laws": [
                    {
                        "physics": name,
                        "parameters": {key: {"value": q.value, "unit": q.unit} for key, q in of.items()},
                    }
                    for name, of in self.plain.laws.items()
                ],
            },
            "runners_up": [{"names": list(names), "probability": p} for names, p in self.runners_up],
            "noise": {
                "torque_nm": self.noise.torque_nm,
                "torque_share": self.noise.torque_share,
                "position_rad": self.noise.position_rad,
                "jitter_s": self.noise.jitter_s,
                "speed_rad_s": self.noise.speed_rad_s,
                "excess": self.excess,
            },
            "timing": {
                "torque_later_s": self.timing.later_s.value,
                "ci95": [self.timing.later_s.low, self.timing.later_s.high],
                "than": self.timing.than,
                "usual_s": self.timing.usual_s,
            },
            "proof": self.proof
            and {
                "runs": list(self.proof.runs),
                "fitted_runs": list(self.proof.fitted),
                "before": self.proof.before,
                "after": self.proof.after,
                "gain_per_sample": self.proof.gain,
                "taken": self.proof.taken,
                "before_nm": self.proof.before_nm,
                "after_nm": self.proof.after_nm,
            },
            "mismatch": [one.to_json() for one in self.mismatch],
            "remainder": [one.to_json() for one in self.remainder],
            "lasting": self.lasting
            and {"torque_nm": self.lasting.torque_nm, "over_noise": self.lasting.over_noise},
            "left": self.left,
            "missed_runs": [{"run": run, "sigma": missed} for run, missed in self.missed_runs],
            "notes": list(self.notes),
        }


def _at(where: Where | None) -> str:
    return f", {where.text}" if where is not None and where.text else ""


def _curve_json(one: Curve) -> dict[str, Any]:
    curve = one.drawn
    return {
        "coordinate": one.coordinate,
        "unit": one.unit,
        "probability": one.probability,
        "torque_rms_nm": one.torque_nm,
        "like": one.like or None,
        "in_file": one.in_file,
        "formula": one.formula or None,
        "formula_after": one.formula_missed,
        "where": one.where and one.where.to_json(),
        "plane": one.plane and one.plane.parameters(),
        "curve": curve
        and {
            "x": curve.x.tolist(),
            "forward_nm": curve.forward_nm.tolist(),
            "forward_std_nm": curve.forward_std_nm.tolist(),
            "backward_nm": curve.backward_nm.tolist(),
            "backward_std_nm": curve.backward_std_nm.tolist(),
        },
    }
