"""Reported torque over what the believed inertia needs: one number over a session, and how well it is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.motion import Array
from schwung.session.model import Run, Session

_TURN = 2 * np.pi
#: The band in which a machine is about rigid and accelerations are not noise.
_BAND_HZ, _BAND_SHARE = 25.0, 0.2
#: Motion of so many times that band makes torques within it, where it is multiplied.
_PRODUCTS = 4.0
#: A coefficient is known when it is so many times its standard error.
KNOWN = 5.0
#: Cut into so many parts, each with a mean torque of its own, runs shall give the same inertia within this factor:
#: one that only shows in slow changes of torque could as well be drift, or friction of another form.
_PARTS, _PARTS_AGREE = (2, 3, 4, 6), 1.3
#: Half waves over the visited angles that tell how an inertia changes over them.
_WAVES = (1, 2, 3)
_MOVES = 0.02  # of the highest speed


@dataclass(frozen=True)
class _Wave:
    """A wave over the angle."""

    order: float  # 1/rad
    phase: float

    def at(self, angle: Array) -> Array:
        return np.asarray(np.cos(self.order * angle + self.phase))

    def slope_at(self, angle: Array) -> Array:
        return np.asarray(-self.order * np.sin(self.order * angle + self.phase))


@dataclass(frozen=True)
class Fitted:
    """Reported torque over the torque that the believed inertia needs: the factor, and how well it is known."""

    factor: float
    error: float  # standard
    within_parts: tuple[float, ...]  # the same from within halves, thirds, … of the runs only

    @property
    def known(self) -> bool:
        """Whether the recording determines an inertia: significant, and the same from its parts."""
        if abs(self.factor) < KNOWN * self.error:
            return False
        return all(1 / _PARTS_AGREE < each / self.factor < _PARTS_AGREE for each in self.within_parts)


def low_pass(values: Array, rate_hz: float, band_hz: float = _BAND_HZ) -> Array:
    """Without lag, to the band in which a machine is about rigid."""
    band = min(band_hz, _BAND_SHARE * rate_hz)
    if values.size < 32:
        return values
    return np.asarray(sosfiltfilt(_filter(band / (rate_hz / 2)), values))


@lru_cache
def _filter(cutoff: float) -> Array:
    """Butterworth sections (k, 6); cutoff over the Nyquist frequency."""
    return np.asarray(butter(4, cutoff, output="sos"))


def change_of(run: Run) -> Array:
    """Of a run's position within the band (rad/s), (n,)."""
    return low_pass(np.gradient(run.position_rad, 1 / run.sample_rate_hz), run.sample_rate_hz)


def inertia_factor(session: Session, machine: Machine) -> Fitted | None:
    """Reported torque over that of the believed inertia, by least squares beside friction, offset and sin θ, cos θ.

    Motion from position alone, in a band in which the machine is about rigid. None where nothing moves or nothing
    accelerates. With an unknown load inertia the factor is over the motor's alone. Where the runs do not agree about
    the believed one, it may be another over the angle: about a number, a crank's is as good as none.
    """
    fitted = _fitted(session, machine, ())
    if fitted is None or fitted.known:
        return fitted
    free = _fitted(session, machine, _waves(session))
    return free if free is not None and free.known else fitted


def _waves(session: Session) -> tuple[_Wave, ...]:
    """How an inertia may change over the angles of all runs: of what turns round and round, with each turn."""
    low = min(float(run.position_rad.min()) for run in session.runs)
    span = max(float(run.position_rad.max()) for run in session.runs) - low
    if session.axis == "rotary" and span > _TURN:
        return tuple(_Wave(order, phase) for order in (1, 2) for phase in (0.0, np.pi / 2))
    return tuple(_Wave(np.pi * k / max(span, 1e-300), -np.pi * k * low / max(span, 1e-300)) for k in _WAVES)


def _fitted(session: Session, machine: Machine, waves: Sequence[_Wave]) -> Fitted | None:
    """The factor beside inertias that change over the angle as `waves` do."""
    rows: list[Array] = []
    torques: list[Array] = []
    shares: list[Array] = []  # how far through its run each sample is, plus the run's number
    peak = max((float(np.max(np.abs(change_of(run)))) for run in session.runs), default=0.0)
    rotary_span = max(float(np.ptp(run.position_rad)) for run in session.runs) if session.runs else 0.0
    swings = session.axis == "rotary" and rotary_span > 1.0
    for run in session.runs:
        rate = run.sample_rate_hz
        speed = change_of(run)
        needed = _needed(run, machine)
        columns = [needed, speed, np.tanh(speed / (_MOVES * peak)) if peak else speed, np.ones_like(speed)]
        columns += [_taken(run, wave.at(run.position_rad), wave.slope_at(run.position_rad)) for wave in waves]
        if swings:
            columns += [np.sin(run.position_rad), np.cos(run.position_rad)]
        known = machine.load_torque_at(run.position_rad)
        edge = min(len(run) // 4, round(rate / _BAND_HZ))
        inside = slice(edge, len(run) - edge)
        moves = np.abs(speed[inside]) > _MOVES * peak
        rows.append(np.column_stack(columns)[inside][moves])
        torques.append(low_pass(run.torque_nm + known, rate)[inside][moves])
        shares.append((np.arange(len(run)) / len(run))[inside][moves] + len(shares))
    if not rows:
        return None
    matrix, torque, share = np.concatenate(rows), np.concatenate(torques), np.concatenate(shares)
    if torque.size < 4 * matrix.shape[1] or np.std(matrix[:, 0]) == 0:
        return None
    rate = session.runs[0].sample_rate_hz
    independent = min(1.0, 2 * _BAND_HZ / rate)  # share of the samples that are, within the band
    factor, error = _coefficient(matrix, torque, independent)
    within = []
    for parts in _PARTS:
        part = np.floor(share * parts).astype(np.int64)
        within.append(
            _coefficient(_within(matrix, part), _within(torque[:, None], part)[:, 0], independent)[0]
        )
    return Fitted(factor, error, tuple(within))


def _needed(run: Run, machine: Machine) -> Array:
    """Torque that the believed inertia needs, (n,), within the band."""
    return _taken(run, *believed_inertia(machine, run.position_rad))


def _taken(run: Run, inertia: Array, slope: Array) -> Array:
    """Torque that an inertia over the motor's angle takes, (n,), within the band; both (n,).

    Products of what is filtered are not filtered products: on a fast stroke inertia itself changes within the band.
    """
    rate = run.sample_rate_hz
    speed = low_pass(np.gradient(run.position_rad, 1 / rate), rate, _PRODUCTS * _BAND_HZ)
    return low_pass(inertia * np.gradient(speed, 1 / rate) + slope * speed**2 / 2, rate)


def believed_inertia(machine: Machine, position: Array) -> tuple[Array, Array]:
    """Believed total inertia over the motor's angle, and its slope."""
    load = machine.load_inertia
    rotor = np.full_like(position, machine.motor.inertia_kgm2)
    if load is None:
        return rotor, np.zeros_like(position)
    if isinstance(load, InertiaTable):
        return rotor + load.at(position), load.slope_at(position)
    return rotor + load, np.zeros_like(position)


def _coefficient(matrix: Array, torque: Array, independent: float) -> tuple[float, float]:
    """The first coefficient of a least squares fit, and its standard error."""
    scale = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-300
    scaled = matrix / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-10)
    fitted = inverse @ (scaled.T @ torque)
    misses = torque - scaled @ fitted
    freedom = max(1.0, independent * torque.size - matrix.shape[1])
    error = np.sqrt(float(misses @ misses) / freedom * float(inverse[0, 0]))
    return float(fitted[0] / scale[0]), float(error / scale[0])


def _within(values: Array, part: NDArray[np.int64]) -> Array:
    """Values (n, k) less the mean of their part."""
    _, index = np.unique(part, return_inverse=True)
    counts = np.bincount(index).astype(float)
    means = np.column_stack([np.bincount(index, column) / counts for column in values.T])
    return np.asarray(values - means[index])
