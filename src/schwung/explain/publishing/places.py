"""Where a belief misses and where each cause acts: over which coordinate, between which values, in which direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from schwung.explain.causes.along import Along
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.location import Residual, interval_of, locate, unit_of
from schwung.explain.publishing.judged import Shown
from schwung.explain.publishing.values import Published, Where
from schwung.explain.values import Located, Model, Overlay, Signal
from schwung.innovations.signals import Signals
from schwung.motion import Array
from schwung.session.model import Axis

#: Samples that locate a mismatch: so many per period of the band's end.
_PER_PERIOD = 4
#: A cause acts in one direction where its mean square in the other is a smaller share than this.
_OTHER_WAY = 0.02
#: Runs for pictures, at most.
_OVERLAYS = 4


@dataclass(frozen=True, eq=False)
class Acts:
    """A cause of the published file: who it is, and what it does."""

    name: str  # of the physics, or the coordinate of a curve
    candidate: Candidate
    shape: Shape
    coefficients: Array

    def takes(self, along: Along) -> Array | None:
        """What it takes of the torque that is missed in a run (N·m), (n,); None: it is of what is reported alone."""
        motor, load = self._on_shafts(along)
        if not (np.any(motor) or np.any(load)):
            return None
        return -(motor if self.between_shafts(along) else motor + load)

    def between_shafts(self, along: Along) -> bool:
        """Whether one shaft gets of it what the other gives, rather than one of them alone."""
        motor, load = self._on_shafts(along)
        return bool(2 * motor @ load < -0.5 * (motor @ motor + load @ load))

    def _on_shafts(self, along: Along) -> tuple[Array, Array]:
        motor, load, _, _ = self.candidate.done(along, self.shape, self.coefficients).alone
        return motor + 0.0 * along.speed, load + 0.0 * along.speed


def where_of(cause: Acts, runs: Sequence[Shown], axis: Axis) -> Where | None:
    """Where a cause acts, along these runs; None where it is of what is reported alone, or does nothing."""
    parts = [cause.takes(run.along) for run in runs]
    taken = [part for part in parts if part is not None]
    if len(taken) < len(runs) or not taken:
        return None
    coordinate = cause.candidate.coordinate.partition(",")[0]
    acts, missed = np.concatenate(taken), np.concatenate([_asked(run) for run in runs])
    speed = np.concatenate([run.along.speed for run in runs])
    energy = float(missed @ missed)
    share: float | None = float(np.clip(acts @ missed / energy, 0.0, 1.0)) if energy > 0 else 0.0
    if all(cause.between_shafts(run.along) for run in runs):
        share = None
    interval: tuple[float, float] | None = None
    if coordinate in _VALUES:
        values = np.concatenate([_coordinate(run.along, coordinate) for run in runs])
        low, high = interval_of(values, acts)
        visited = float(np.ptp(values))
        interval = (low, high) if high - low < _EVERYWHERE * visited else None
    return Where(coordinate, interval, _unit(coordinate, axis), _way(acts, speed), share)


def _asked(run: Shown) -> Array:
    """What the motion asked for beyond what the machine needs (N·m), (n,): reported minus needed."""
    return -run.missed_nm


#: An interval that is a larger part of what was visited is all of it.
_EVERYWHERE = 0.98
_SIGNALS: tuple[Signal, ...] = ("torque", "speed")
_VALUES = ("position", "speed", "acceleration", "torque", "time_in_motion")


def _unit(coordinate: str, axis: Axis) -> str:
    return unit_of(coordinate, axis) if coordinate in _VALUES else ""  # type: ignore[arg-type]


def _coordinate(along: Along, coordinate: str) -> Array:
    choices: dict[str, Callable[[], Array]] = {
        "position": lambda: along.load_angle,
        "speed": lambda: along.speed,
        "acceleration": lambda: along.load_acceleration,
        "torque": lambda: along.torque,
    }
    return choices.get(coordinate, lambda: along.motion_time_s)()


def _way(acts: Array, speed: Array) -> str:
    """The only direction of motion in which it acts; empty: both, or only one was recorded."""
    still = 0.02 * float(np.max(np.abs(speed), initial=0.0))
    ahead, back = (acts[way] for way in (speed > still, speed < -still))
    if not (ahead.size and back.size):
        return ""
    forward, backward = float(np.mean(ahead**2)), float(np.mean(back**2))
    if backward < _OTHER_WAY * forward:
        return "forward"
    return "backward" if forward < _OTHER_WAY * backward else ""


def with_places(
    found: Published, before: Sequence[Shown], after: Sequence[Shown], band_hz: float
) -> Published:
    """With the coordinates that follows what the belief misses in fitted runs, and what the file does; nothing where
    that is not plain."""
    verdict = found.verdict
    if verdict == "consistent":
        return found

    def missed(runs: Sequence[Shown], by: Model, surely: bool) -> tuple[Located, ...]:
        located = (
            locate([_residual(run, of, by, band_hz) for run in runs], found.axis, surely=surely)
            for of in _by_what_is_missed(runs)
        )
        return next(filter(None, located), ())

    left = found.in_file and verdict != "explained"
    return replace(
        found,
        mismatch=missed(before, "the belief", verdict != "unexplained"),
        remainder=missed(after, "the file", True) if left else (),
    )


def _by_what_is_missed(runs: Sequence[Shown]) -> list[Signal]:
    """Torque and reported speed, first that of which more is missed over its noise: the squares of both are what makes
    the runs unlikely. A speed that is reported late goes with no torque."""

    def square(of: Signal) -> float:
        each = (np.divide(*_missed(run, of))[run.along.moves] for run in runs)
        return float(sum(np.sum(one**2) for one in each))

    told = all(run.missed_rad_s is not None for run in runs)
    return sorted(_SIGNALS[: 1 + told], key=square, reverse=True)


def _missed(run: Shown, of: Signal) -> tuple[Array, Array]:
    """What is missed of a signal (N·m or rad/s), and its noise's deviations, (n,) each."""
    if of == "speed":
        assert run.missed_rad_s is not None
        return run.missed_rad_s, run.speed_noise_rad_s
    return _asked(run), run.torque_noise_nm


def _heard(run: Signals) -> float:
    """How much of white noise is within the band, mean square."""
    pulse = np.zeros_like(run.time_s)
    pulse[pulse.size // 2] = 1.0
    return float(np.sum(run.quiet(pulse) ** 2))


def _residual(run: Shown, of: Signal, by: Model, band_hz: float) -> Residual:
    along, step = run.along, run.along.run.step_s
    every = max(1, int(1 / (_PER_PERIOD * band_hz * step)))
    at = slice(None, None, every)
    missed, noise = _missed(run, of)
    return Residual(
        run=run.run,
        rate_hz=1 / (step * every),
        time_in_motion_s=along.motion_time_s[at],
        position_rad=along.load_angle[at],
        speed_rad_s=along.speed[at],
        acceleration_rad_s2=along.acceleration[at],
        torque_nm=along.torque[at],
        missed=along.run.quiet(missed)[at],
        considered=along.moves[at],
        noise=float(np.sqrt(np.mean(noise**2) * _heard(along.run))),
        injected_hz=run.injected_hz,
        of=of,
        by=by,
    )


def overlays(
    before: Sequence[Shown], after: Sequence[Shown], causes: Sequence[Acts], heldout: Sequence[int]
) -> tuple[Overlay, ...]:
    """A few runs for pictures: those kept aside first, the worst first, and those in which a cause does the most."""
    pairs = {one.run: (one, other) for one, other in zip(before, after, strict=True)}
    aside = [run for run in pairs if run in heldout]
    order = sorted(pairs, key=lambda run: (run not in aside, -float(np.mean(pairs[run][0].missed_nm ** 2))))
    chosen = order[:1]
    for cause in causes:
        sizes = {run: _size(cause.takes(pairs[run][1].along)) for run in order}
        chosen.append(max(order, key=lambda run: sizes[run]))
    every = list(dict.fromkeys([*chosen, *order]))[:_OVERLAYS]
    return tuple(_overlay(*pairs[run], causes, run in aside) for run in every)


def _size(taken: Array | None) -> float:
    return 0.0 if taken is None else float(np.mean(taken**2))


def _overlay(before: Shown, after: Shown, causes: Sequence[Acts], heldout: bool) -> Overlay:
    along, of = after.along, after.along.run
    torque = np.asarray(of.quiet(of.drive.whole_nm))
    terms = {cause.name: cause.takes(along) for cause in causes}
    return Overlay(
        run=after.run,
        heldout=heldout,
        time_s=of.time_s,
        position_rad=along.angle,
        speed_rad_s=along.speed,
        acceleration_rad_s2=along.acceleration,
        torque_nm=torque,
        before_nm=torque - _asked(before),
        after_nm=torque - _asked(after),
        terms_nm={name: taken for name, taken in terms.items() if taken is not None},
        considered=along.moves,
        motion_time_s=along.motion_time_s,
        speed_before_rad_s=before.missed_rad_s,
        speed_after_rad_s=after.missed_rad_s,
    )
