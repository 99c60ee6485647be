"""The torque of a run as causes see it: without its noise, what of it drives the machine, and how both change; and what
noise alone seems to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from schwung.innovations.likelihood import Noise
from schwung.innovations.low_pass import low_passed
from schwung.innovations.signals import SHORTEST, WIDEST, Between, Signals
from schwung.innovations.splines import bends, slopes
from schwung.motion import Array

#: Of a `TrueTorque`, what is not worked out again about another set.
_CHANGES = ("within_steps", "asked_nm", "rate", "sharp_rate", "bend", "beyond_band")


@dataclass(frozen=True, eq=False)
class TrueTorque:
    """Of one run, as far as it is known (N·m, (n,)): the reported one but for its noise, which would else explain
    itself; a held injection as if it was taken at once.

    Noise is what a filter does not foresee. Where it is the sensor's, it bends nothing between samples; where it stands
    for contacts that are faster than samples tell, the torque bends as it was sampled.

    `driving_nm`: what drives the machine with what is present. What is missed is no part of it: if it were, a scale of
    the torque would make all of the equation smaller, and with it what is missed.
    """

    run: Signals
    nm: Array
    driving_nm: Array | None = None
    as_sampled: bool = (
        True  # whether it bends between samples as what is reported does; else as it does itself
    )

    def with_driving(self, nm: Array) -> TrueTorque:
        """The same about something else; how the torque changes is not worked out again."""
        other = replace(self, driving_nm=nm)
        other.__dict__.update({name: self.__dict__[name] for name in _CHANGES if name in self.__dict__})
        return other

    @cached_property
    def within_steps(self) -> Between:
        """What is reported, over the steps between samples."""
        drive = self.run.drive
        return drive.undelayed if self.as_sampled else drive.within_steps(self.nm)

    @property
    def noise_nm(self) -> tuple[Array, Array, Array]:
        """What of that is noise, at the start and at the end of each step, and the height of a parabola between,
        (n − 1,) each."""
        drive, whole = self.run.drive, self.within_steps
        quiet = self.nm - drive.injected_nm
        start, end, height = drive.held.over_steps(0.0).T
        return (
            whole.start_nm - start - quiet[:-1],
            whole.end_nm - end - quiet[1:],
            whole.bulge_nm - height - bends(quiet, self.run.step_s),
        )

    @cached_property
    def quiet_nm(self) -> Array:
        """Within the band."""
        return np.asarray(self.run.quiet(self.nm if self.driving_nm is None else self.driving_nm))

    @cached_property
    def asked_nm(self) -> Array:
        """Within the band, whatever of it drives the machine."""
        return np.asarray(self.run.quiet(self.nm))

    @cached_property
    def rate(self) -> Array:
        return slopes(self.asked_nm, self.run.step_s)

    @cached_property
    def sharp_rate(self) -> Array:
        """Beyond the band as well, where contacts are answered."""
        return slopes(self.nm, self.run.step_s)

    @cached_property
    def bend(self) -> Array:
        """Second derivative."""
        return slopes(self.run.quiet(self.rate), self.run.step_s)

    @cached_property
    def beyond_band(self) -> Array:
        """How torque and the motor's speed change beyond the band (N·m/s, rad/s²), (n, 2), for all sets alike.

        As each set's own states say it, a late speed is corrected by how it changes, and changes by how it was
        corrected: at a rate of 2 kHz and 0.3 ms that went on for ever. At either end it is nothing, for a slope there
        is mostly the last sample's own error.
        """
        rough = np.column_stack([self.nm, self.run.states[:, 1]])
        found = slopes(rough - self.run.quiet(rough), self.run.step_s)
        found[[0, -1]] = 0.0
        return found


def torque_noise(run: Signals, noise: Noise) -> float:
    """Standard deviation of the torque's error at each sample of a run that is taken (N·m)."""
    power = noise.torque_nm**2 + np.mean((noise.torque_share * run.load_nm) ** 2)
    return float(np.sqrt(power / run.drive.every))


#: Limits that are looked at, up to the peak.
_LIMITS = 200


def seems_clipped(runs: Sequence[Signals]) -> tuple[tuple[float, float], ...]:
    """Limits of the torque (N·m), rising, and what share of all that is reported beyond them noise alone makes seem
    clipped, at most (two standard deviations).

    Samples beyond a limit that is hardly passed are those whose noise is large, and the machine moves as if that was
    not there: of n of them s = σ² n / Σ b², of what each is beyond by, with a variance of s (1 + s) / n (Stein's lemma
    for Σ e b of a normal noise e, and its square). What is beyond the band is noise; where there is no such, none is
    known.
    """
    every, power = [], []
    for run in runs:
        edge = 2 * run.band_hz * run.step_s / run.drive.every
        nm = run.drive.recorded_nm if run.drive.every > 1 else run.drive.whole_nm
        every.append(np.abs(nm))
        if edge < WIDEST and nm.size > SHORTEST:
            power.append(float(np.mean((nm - low_passed(nm, edge, 4)) ** 2)) / (1 - edge))
    asked = np.concatenate(every)
    found = []
    for limit in np.linspace(0.0, float(np.max(asked)), _LIMITS, endpoint=False):
        beyond = asked[asked > limit] - limit
        noise = float(np.mean(power)) * beyond.size if power else 0.0
        share = noise / max(float(beyond @ beyond), 1e-300)
        found.append((float(limit), share + 2 * float(np.sqrt(share * (1 + share) / beyond.size))))
    return tuple(found)
