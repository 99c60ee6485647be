"""A candidate: a cause with a name, the shapes that it may have, and how large it naturally is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.special import log_ndtr, ndtr

from schwung.explain.causes.along import Along
from schwung.innovations.effect import Effect
from schwung.innovations.values import FurtherMass
from schwung.motion import Array

Shape = tuple[float, ...]
#: Standard deviation of a cause's torque, over the session's peak torque.
NATURAL = 0.1
#: A law is right to this share of what it does, and so is what is believed.
RIGHT_TO = 0.003
#: A shape is at its bound within this share of the range.
_END = 1e-3
#: Sizes of a curve that are tried, over its natural one: evenly in the logarithm, a factor of about three apart.
LADDER = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.003)
#: And of what one motion has of its own: it could be anything, so that what is larger has to follow something else.
SMALL = LADDER[3:]


#: About coefficients: what a unit more of each adds, and all that they do (one column).
Bent = Callable[[Along, Shape, Array], tuple[Effect, Effect]]


@dataclass(frozen=True, eq=False)
class Missed:
    """Of one run: torque that is missed with what is present (N·m, (n,)) at angles (rad, (n,)), each `step_s`, and what
    was injected (Hz)."""

    torque_nm: Array
    angle_rad: Array
    step_s: float
    injected_hz: tuple[float, ...]
    along: Along | None = None  # the run's other coordinates


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause of the vocabulary. Its coefficients are normal about 0 with `deviations` times one of `scales`.

    What changes the load inertia or the coupling is part of the machine wherever it is present (`inertia`, `coupling`),
    not a torque along the run: the filter then knows how such a machine moves.
    """

    name: str
    effect: Callable[[Along, Shape], Effect]
    deviations: Shape
    keys: Callable[[Array, Shape], Mapping[str, float]] = lambda _coefficients, _shape: {}
    shapes: tuple[Shape, ...] = ((),)
    sought: Callable[[Sequence[Missed]], tuple[Shape, ...]] | None = (
        None  # shapes that are worth a look, where there are too many to have columns for all
    )
    choices: int = 0  # how many those are sought among
    spacing: Shape = ()  # of the shapes' grid, in each of their numbers
    bounds: tuple[tuple[float, float], ...] = ()  # within which a shape is one
    endless: tuple[int, ...] = ()  # numbers of the shape whose bounds are as good as what lies beyond
    bends: tuple[float, float] | None = (
        None  # of the first number of its shape over its only coefficient: what it naturally is, and how far off that
    )
    bends_told: float = 0.0  # the same ratio, exactly, as a file has it
    logarithmic: tuple[bool, ...] = ()  # numbers of the shape that are refined by factors
    scales: tuple[float, ...] = (1.0,)
    positive: tuple[int, ...] = ()  # coefficients that cannot be below `least`
    often_none: bool = False  # whether it is as often nothing at all
    least: Shape = ()  # what is believed, the sign turned: no total is negative; empty: nothing is believed
    frictions: tuple[Array, float] | None = (
        None  # of a curve of friction, values by its coefficients (g, p) and what is believed: no total pushes
    )
    named: bool = True
    coordinate: str = ""
    part_of: str = ""  # a curve with a name that it is a part of, where a set holds both
    family: str = ""  # of which a set holds one at most: each is a case of another
    cases: frozenset[str] = frozenset()  # names that are cases of this one: a set holds it or them
    limit: str = ""  # a name that it comes to in its limit: it is that, and something more
    behind: str = ""  # a name that it has on the motor: it is that behind the coupling
    causes: int = 1  # as which it counts beforehand: near its limit nothing tells it from that
    own: tuple[Callable[[Along, Shape], Array], ...] = ()  # that its law may be off over, −1…1; none: by name
    others: Candidate | None = None  # what other laws of it do, in place of that
    tangent: Callable[[Along, Shape, Array], Array] | None = (
        None  # to stiffness and damping along a run, (n, 2)
    )
    drives: Callable[[Along, Shape, Array], tuple[Array, Array]] | None = (
        None  # how much further than the motor turns it drives the coupling (rad), and how much faster (rad/s), (n,)
    )
    heavier: Callable[[Along, Shape, Array], Array] | None = (
        None  # what it adds to the load's inertia along a run: its slope by the acceleration, (n,)
    )
    whole: Callable[[Along, Shape, Array], Effect] | None = (
        None  # `done`, where there is a shorter way, or where states that rest with it know a part of `effect`
    )
    bent: Bent | None = None  # where it is not in proportion to its coefficients; `effect` is then about 0
    inertia: Callable[[Array, Shape], Array] | None = (
        None  # what a unit of each adds to J_l at angles, (n, p)
    )
    inertia_whole: Callable[[Array, Array], Array] | None = (
        None  # what all of it adds to J_l at angles, (n,), where that is not in proportion to its coefficients
    )
    none_of: Callable[[Array, Shape], bool] | None = (
        None  # whether these coefficients and this shape are none that it can have, or make it something else
    )
    of_motion: bool = False  # what one motion has of its own: no file says it, for another motion has another
    unsaid: Callable[[Array, Array, Shape, str], str] | None = (
        None  # what no file can say of it, in words: by coefficients, their deviations, shape and the torque's unit
    )
    swings: bool = False  # whether what it does to the load follows from how the load moves then
    further: Callable[[Array, Shape], FurtherMass] | None = (
        None  # the mass behind the load that the filter can carry as a state of its own
    )
    passes: Callable[[Along, Shape, Array], Array] | None = (
        None  # what the motor gives more for a torque more, (n,), where that is not always as much
    )
    each_run: bool = False  # its coefficients are each run's own, and say nothing of another
    known_to: float = (
        0.0  # size of its coefficients that the belief is usually off by: a smaller change is no finding
    )
    felt: Callable[[Shape], float] = (
        lambda _shape: 1.0  # how many times its coefficients count where that is compared, by its shape
    )
    with_usual: Mapping[str, Shape] = field(
        default_factory=dict  # what a unit of each coefficient of usual causes adds to its one, where that is compared
    )
    late: tuple[float, float] = (
        0.0,
        0.0,
    )  # by how much torque and speed are reported later for a unit of its first coefficient (s)
    products: Array | None = (
        None  # of a curve's modes, by which its size is measured (p, p); None: of the coefficients
    )
    rotor: float = 0.0  # what a unit of it adds to the motor's inertia
    coupling: tuple[float, float, float] = (0.0,) * 3  # what a unit of it adds to stiffness, damping and gap
    unfilters: bool = False  # its first coefficient is by how much a filter delays the reported torque (s)
    holds: bool = False  # its coefficient is by what share of a step a held injection is taken later
    elsewhere: tuple[float, ...] = ()  # of its only coefficient, from where it is looked for as well

    @property
    def size(self) -> int:
        """Coefficients of one shape."""
        return len(self.deviations)

    @property
    def yields(self) -> bool:
        """Whether it changes how motor and load give way to each other."""
        return any(self.coupling) or self.tangent is not None or self.swings

    @property
    def instead_of_laws(self) -> bool:
        """Whether it is a curve that does whatever laws of the coupling do: asked for where they are not enough."""
        return self.tangent is not None and not self.named

    @property
    def bends_by_shape(self) -> bool:
        """Whether it bends the coupling in more ways than one."""
        return self.tangent is not None and len(self.shapes) > 1

    @property
    def shape_log(self) -> float:
        """Log of the share that one shape has of all that there are, before anything is seen."""
        return -float(np.log(self.choices or len(self.shapes)))

    @property
    def bounds_below(self) -> tuple[tuple[int, float], ...]:
        """Coefficients that have a lower bound, and that bound."""
        return tuple(zip(self.positive, self.least or (0.0,) * len(self.positive), strict=True))

    def allowed(self, coefficients: Array, spread: Array, deviations: Array) -> float:
        """Log probability that no coefficient is beyond its bound, over that before anything was seen; all (p,).

        Where it is as often nothing as anything, the density at nothing counts as well (Savage and Dickey's ratio).
        """
        log = 0.0
        for which, least in self.bounds_below:
            mean, wide, open_to = coefficients[which], spread[which], deviations[which]
            within = float(log_ndtr((mean - least) / wide) - log_ndtr(-least / open_to))
            if self.often_none:
                nothing = float(np.log(open_to / wide) - 0.5 * (mean / wide) ** 2)
                within = float(np.logaddexp(within, nothing) - np.log(2))
            log += within
        return log

    def beyond(self, coefficients: Array, covariance: Array, shape: Shape = ()) -> float:
        """Probability that a change is larger than the belief is usually off by; (p,), (p, p)."""
        if self.known_to == 0:
            return 1.0
        along = coefficients if self.products is None else self.products @ coefficients
        size = float(np.sqrt(along @ coefficients))
        spread = float(np.sqrt(along @ covariance @ along)) / max(size, 1e-300)
        return float(ndtr((size - self.known_to / self.felt(shape)) / max(spread, 1e-300)))

    def possible(self, coefficients: Array) -> bool:
        """Whether none of its coefficients is beyond its bound."""
        return all(coefficients[which] > least for which, least in self.bounds_below)

    def takes(self, coefficients: Array, covariance: Array) -> float:
        """Chance of friction that is found as far below zero as this while none is; (p,), (p, p).

        Friction takes energy, wherever it is; a curve that gives some is something else. Of so many points as it has
        coefficients the least is compared: more are alike.
        """
        if self.frictions is None:
            return 1.0
        values, believed = self.frictions
        spread = np.sqrt(np.einsum("gi,ij,gj->g", values, covariance, values))
        least = float(np.min((values @ coefficients + believed) / np.maximum(spread, 1e-300)))
        return min(1.0, self.size * float(ndtr(least)))

    def is_another(self, coefficients: Array, shape: Shape) -> bool:
        """Whether a part of a law is next to nothing, less than a law is right to: friction that hardly falls is dry
        friction; or whether its numbers are those of something else."""
        if self.none_of is not None and self.none_of(coefficients, shape):
            return True
        totals = [(coefficients[i] - least) / self.deviations[i] for i, least in self.bounds_below]
        return len(totals) > 1 and not self.opens and bool(0 <= min(totals) <= RIGHT_TO * max(totals))

    def at_end(self, shape: Shape, coefficients: Array) -> bool:
        """Whether a shape is at the end of what is tried, as far as that means anything; or a gap has closed to less
        than any that is tried: without one, contacts that only push are another machine, but no play.
        """
        if self.opens:
            return bool(coefficients[0] < self.shapes[0][0])
        if self.is_another(coefficients, shape):
            return True
        every = zip(shape, self.bounds, self.logarithmic, strict=True) if self.bounds else ()
        for number, (value, ends, factor) in enumerate(every):
            at, low, high = np.log([value, *ends]) if factor else (value, *ends)
            if number not in self.endless and min(at - low, high - at) <= _END * (high - low):
                return True
        return False

    @property
    def is_law(self) -> bool:
        """Whether it has a name, and few numbers: no curve."""
        return self.named and len(self.scales) == 1

    @property
    def is_inertia_curve(self) -> bool:
        """Whether it is an inertia that may be any over the angle."""
        return self.named and self.inertia is not None and not self.is_law

    @property
    def is_number(self) -> bool:
        """Whether it is a change of one number of the belief."""
        return self.named and self.size == 1 and not self.spacing and self.known_to > 0

    @property
    def shown_by_accelerating(self) -> bool:
        """Whether nothing shows it at a steady speed: inertia, coupling, scale and lag of the torque, and whatever goes
        with torque or acceleration, which hardly change there."""
        over = self.coordinate.split(", ")
        shown = self.of_machine or self.tangent is not None or self.name == "torque_ripple"
        shown = shown or any(one in over for one in ("acceleration", "torque"))
        shown = shown or ("frequency" in over and not self.each_run)
        return shown and not self.name.startswith("usual")

    def unbent(self, shape: Shape, coefficients: Array) -> tuple[float, float, float]:
        """How many deviations its shape is off what is natural, and that by its coefficient and by its shape."""
        assert self.bends is not None
        ratio, share = self.bends
        wide = share * max(float(coefficients[0]), self.known_to)
        return (shape[0] - ratio * float(coefficients[0])) / wide, -ratio / wide, 1 / wide

    @property
    def opens(self) -> bool:
        """Whether it opens a gap: that is no line about a coupling without, so that it is always tried."""
        return self.coupling[2] != 0

    @property
    def of_machine(self) -> bool:
        """Whether it is a change of the machine's inertias or coupling."""
        return self.inertia is not None or self.rotor != 0 or any(self.coupling)

    def moved(self, shape: Shape, spacings: Array) -> Shape:
        """A shape so many spacings of the grid on (d,), within its bounds."""
        every = (
            zip(shape, spacings, self.spacing, self.logarithmic, self.bounds, strict=True)
            if self.spacing
            else ()
        )
        found = []
        for value, by, spacing, factor, (low, high) in every:
            further = (
                value * float(np.exp(np.clip(by * spacing, -100, 100)))
                if factor
                else value + float(by) * spacing
            )
            found.append(min(max(further, low), high))
        return tuple(found) if self.spacing else shape

    def inertia_added(self, angle: Array, shape: Shape, coefficients: Array) -> Array:
        """What it adds to J_l at angles (n,) with these coefficients, (n,)."""
        if self.inertia_whole is not None:
            return self.inertia_whole(angle, coefficients)
        assert self.inertia is not None
        return np.asarray(self.inertia(angle, shape) @ coefficients)

    def done(self, along: Along, shape: Shape, coefficients: Array) -> Effect:
        """All that it does with these coefficients, one column."""
        if self.bent is not None:
            return self.bent(along, shape, coefficients)[1]
        if self.whole is not None:
            return self.whole(along, shape, coefficients)
        parts = self.effect(along, shape).parts
        return Effect(*(None if part is None else part @ coefficients[:, None] for part in parts))

    def about(self, coefficients: Array) -> Candidate:
        """The same, linear about these coefficients."""
        bent = self.bent
        if bent is None:
            return self
        return replace(self, effect=lambda along, shape: bent(along, shape, coefficients)[0])

    def excludes(self, other: Candidate) -> bool:
        """Whether no set holds both."""
        alike = self.family != "" and self.family == other.family
        return alike or self.name == other.name or other.name in self.cases or self.name in other.cases


def grid(*each: Sequence[float] | Array) -> tuple[Shape, ...]:
    """All combinations."""
    return tuple(tuple(float(value) for value in row) for row in product(*each))
