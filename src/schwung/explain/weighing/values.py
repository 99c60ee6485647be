"""What weighing says: names with their probabilities and parameters, the curves that have none, and the proof."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from schwung.innovations.likelihood import Noise


@dataclass(frozen=True)
class Parameter:
    """A value with the ends of its interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Named:
    """A name, how probable it is, and its parameters in the most probable set that holds it."""

    name: str
    probability: float
    parameters: Mapping[str, Parameter]


@dataclass(frozen=True)
class Unnamed:
    """What the motion follows over a coordinate and no name stands for."""

    coordinate: str
    probability: float
    torque_nm: float  # root mean square along the runs
    like: str = ""  # the name whose law comes near; empty: a curve


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
class Lasting:
    """What repeats of a motion differ by for longer than noise does: something goes on from one run to the next."""

    torque_nm: float  # root mean square, of one run
    over_noise: float  # over what neighbouring samples do not share


@dataclass(frozen=True)
class Weighed:
    """The answer. `names`, most probable first, are all with a probability worth telling."""

    names: tuple[Named, ...]
    unnamed: tuple[Unnamed, ...]
    noise: Noise
    excess: float  # the likelihood is tempered by it: colour of the noise, and physics that has no name
    notes: tuple[str, ...] = ()

    def probability(self, name: str) -> float:
        """Of a name; 0 where it was not worth telling."""
        return next((one.probability for one in self.names if one.name == name), 0.0)
