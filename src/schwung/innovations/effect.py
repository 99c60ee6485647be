"""What causes of torque, and errors of what is reported, add to the innovations of a run.

To first order in its coefficients any cause is a torque on the motor, a torque on the load, and an error of the
reported angle and speed, all along the run's smoothed states: another stiffness is k·twist between both, another
inertia −δJ·α on the load, a late speed −δt·α in the speed's samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from schwung.innovations import kalman, kernel
from schwung.innovations.likelihood import Equations, Noise, problem_of, torque_errors, variances_of
from schwung.innovations.signals import Signals
from schwung.innovations.statistics import Columns
from schwung.innovations.steps import Steps
from schwung.innovations.values import Filtered
from schwung.motion import Array


@dataclass(frozen=True, eq=False)
class Effect:
    """What a unit of each of p coefficients adds along one run, (n, p) each; None: nothing."""

    on_motor: Array | None = None  # N·m
    on_load: Array | None = None
    position: Array | None = None  # rad, of the reported angle
    speed: Array | None = None  # rad/s, of the reported speed

    @property
    def parts(self) -> tuple[Array | None, ...]:
        """The four, in their order."""
        return self.on_motor, self.on_load, self.position, self.speed

    @property
    def count(self) -> int:
        """p."""
        for part in self.parts:
            if part is not None:
                return int(part.shape[1])
        raise ValueError("an effect does something")

    @property
    def kind(self) -> tuple[bool, bool, bool, bool]:
        """Which of the four there are."""
        return (
            self.on_motor is not None, self.on_load is not None,
            self.position is not None, self.speed is not None,
        )  # fmt: skip

    @property
    def alone(self) -> tuple[Array | float, Array | float, Array | float, Array | float]:
        """The four of its only coefficient, (n,) each; 0.0: nothing."""
        motor, load, position, speed = (0.0 if part is None else part[:, 0] for part in self.parts)
        return motor, load, position, speed

    def of(self, coefficients: Array) -> tuple[Array | float, Array | float, Array | float, Array | float]:
        """The four with these coefficients (p,), summed, (n,) each; 0.0: nothing."""
        motor, load, position, speed = (
            0.0 if part is None else np.asarray(part @ coefficients) for part in self.parts
        )
        return motor, load, position, speed


#: Columns that are whitened together: what is carried of them stays in the nearest memory.
_TOGETHER = 32
#: So few are whitened together whatever they act on: what each sample takes by itself is more than they do.
_FEW = 8
#: States for which a processor has registers: of motor, coupling and load, and the torque's error.
_IN_REGISTERS = 5


@dataclass(frozen=True, eq=False)
class Passed:
    """One run, filtered: what effects are whitened by."""

    equations: Equations
    steps: Steps
    result: Filtered
    noise: Noise
    run: Signals
    measured: int = 0  # how many of the samples tell anything: n where no speed was measured

    @classmethod
    def of(cls, equations: Equations, steps: Steps, noise: Noise, run: Signals) -> Passed:
        """Filter a run."""
        result = kalman.filtered(problem_of(equations, noise, run))
        return cls(
            equations, steps, result, noise, run, result.error.size // (1 if run.speed_measured else 2)
        )

    def of_noise(self, noise: Noise, run: Signals, chance: np.random.Generator) -> Passed:
        """The same run, had there been nothing but noise: of a linear filter, what its states hold of that."""

        def drawn(variances: Array) -> Array:
            return np.asarray(np.sqrt(variances) * chance.standard_normal(variances.shape))

        at_samples, within = torque_errors(noise, run)
        torque, measured, alone = map(drawn, (at_samples, variances_of(noise, run), within))
        first, last = self.equations.transition[:, :-1, -1], self.equations.noise[:, :-1]
        forcing = np.zeros_like(self.equations.forcing)
        forcing[:, :-1] = -(first * (torque[:-1] + alone)[:, None] + last * (torque[1:] + alone)[:, None])
        still = replace(
            self.equations,
            forcing=forcing,
            measured=measured,
            first=np.zeros_like(self.equations.first),
        )
        return Passed.of(still, self.steps, noise, run)

    def driven(self, torques: Array) -> Passed:
        """The same run with nothing in it but torques on the motor over each step: at its start, at its end, and the
        height of a parabola between, (n − 1, 3)."""
        forcing = np.zeros_like(self.equations.forcing)
        forcing[:, :-1] = np.einsum("ksi,ki->ks", self.steps.inputs[:, :, 0::2], -torques)
        still = replace(
            self.equations,
            forcing=forcing,
            measured=np.zeros_like(self.equations.measured),
            first=np.zeros_like(self.equations.first),
        )
        return replace(self, result=kalman.filtered(problem_of(still, self.noise, self.run)))

    @property
    def innovations(self) -> Array:
        """Angle's and speed's in turn, white with deviation 1 where the model holds, (2n,)."""
        return np.asarray(self.result.error / np.sqrt(self.result.variance)).reshape(-1)

    @property
    def deviances(self) -> Array:
        """−2 log likelihood of each sample, but for a constant, (n,)."""
        each = np.log(self.result.variance) + self.result.error**2 / self.result.variance
        return np.asarray(np.sum(each, axis=1))

    @cached_property
    def unsure(self) -> float:
        """How much less surely the samples are foreseen for the coupling's gap (−2 log likelihood)."""
        play = self.equations.play
        return 0.0 if play is None else float(np.sum(np.log(self.result.variance))) - play.logs_without

    @property
    def samples(self) -> int:
        """2n: of angle and speed, measured or not."""
        return int(self.result.error.size)

    @cached_property
    def states(self) -> Array:
        """Smoothed ones, (n, s), and the torque's error (N·m) behind them."""
        return np.asarray(kernel.smoothed(self.equations.transition, self.result))

    @cached_property
    def torque_error_nm(self) -> Array:
        """By how much more torque is reported than acts at each sample (N·m), (n,): the state, and what the steps
        beside it have of their own. What dry friction leaves open within a step is none of it."""
        alone = torque_errors(self.noise, self.run)[1]
        if not np.any(alone):
            return np.asarray(self.states[:, -1])
        ahead = kernel.adjoints(self.equations.transition, self.result)[1:, :-1]
        along = self.equations.transition[:, :-1, -1] + self.equations.noise[:, :-1]
        step = -alone * np.einsum("ks,ks->k", along, ahead)
        own = np.append(step, step[-1]) + np.concatenate([step[:1], step])
        return np.asarray(self.states[:, -1] + own / 2)

    @property
    def speed_error_rad_s(self) -> Array:
        """By how much more the speed is reported than follows at each sample (rad/s), (n,)."""
        return np.asarray(self.equations.measured[:, 1] - self.states[:, 1])

    @property
    def shaft_states(self) -> Array:
        """Those of motor and load, (n, 2 or 4): what is behind the load is no more than follows from these."""
        return np.ascontiguousarray(self.states[:, : self.run.states.shape[1]])

    def whitened(self, effects: Sequence[Effect]) -> Array:
        """Effects side by side as the innovations show them, (Σp, 2n): filtered alike, over their deviation."""
        rows = np.empty((sum(effect.count for effect in effects), self.samples))
        whiten([self], effects, rows)
        return rows

    def respond(self, sides: Sequence[Array], rows: Columns | Array, down: int, across: int) -> None:
        """Write what columns of one kind show to `rows` from [down, across] on; `sides`: of `Effect`, (n, p), in C's
        order, or (n, 0) for nothing."""
        acts = [side.shape[1] > 0 for side in sides]
        four = sides[0], sides[1], sides[2], sides[3]
        if self.result.state.shape[1] > _IN_REGISTERS:
            transition, inputs = self.equations.transition, self.steps.inputs
            kernel.responses_of_six(transition, self.result, inputs, four, rows, down, across)
            return
        if sum(acts) == 1 and not any(acts[2:]):
            side = acts.index(True)
            kernel.responses_to_torque(self._loop, sides[side], side, rows, down, across)
            return
        kernel.responses(self._loop, four, rows, down, across)

    @cached_property
    def _loop(self) -> Array:
        return np.asarray(kernel.closed_loop(self.equations.transition, self.result, self.steps.inputs))


def whiten(
    passed: Sequence[Passed], effects: Iterable[Effect], rows: Columns | Array, across: int = 0
) -> None:
    """Write effects along some runs, one behind another, as their innovations show them to `rows` (≥ Σp,
    ≥ across + Σ2n, in C's order) from [0, across] on."""
    at, waiting = 0, 0
    group: list[Effect] = []
    alike: tuple[bool, ...] = ()  # what all in the group act on; nothing: on one thing and another
    for effect in effects:
        kind, count = effect.kind, effect.count
        few = waiting + count <= _FEW
        if group and (waiting + count > _TOGETHER or not (few or kind == alike)):
            _respond(passed, group, rows, at, across)
            at, waiting, group = at + waiting, 0, []
        alike = kind if not group or kind == alike else ()
        group.append(effect)
        waiting += count
    if group:
        _respond(passed, group, rows, at, across)


def _respond(
    passed: Sequence[Passed], group: list[Effect], rows: Columns | Array, down: int, across: int
) -> None:
    """Of effects that are whitened together."""
    samples = sum(one.result.error.shape[0] for one in passed)
    sides = [np.empty((samples, 0))] * 4
    for which in range(4):
        each = [effect.parts[which] for effect in group]
        if any(part is not None for part in each):
            columns = [
                np.zeros((samples, effect.count)) if part is None else part
                for part, effect in zip(each, group, strict=True)
            ]
            sides[which] = np.ascontiguousarray(
                columns[0] if len(columns) == 1 else np.concatenate(columns, axis=1)
            )
    first = 0
    for one in passed:
        last = first + one.result.error.shape[0]
        one.respond([side[first:last] for side in sides], rows, down, across + 2 * first)
        first = last
