"""What weighing says: names with their probabilities and parameters, and the curves that have none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from schwung.innovations.likelihood import Noise

#: What is more probable than this is told by its name.
NAMED = 0.5


@dataclass(frozen=True)
class Parameter:
    """A value with the ends of its interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Named:
    """A name, how probable it is, and its parameters: as in the most probable set that holds it, intervals over all."""

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
class Timing:
    """By how much later torque is reported than speed, or than angle where no speed was measured, beyond what is
    believed: all of that, whether it has a name or is usual."""

    later_s: Parameter
    than: str  # "speed" or "position"
    usual_s: float  # standard deviation of what drives usually have


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
    timing: Timing
    notes: tuple[str, ...] = ()

    def probability(self, name: str) -> float:
        """Of a name; 0 where it was not worth telling."""
        return next((one.probability for one in self.names if one.name == name), 0.0)
