"""The load's side of the coupling, from what the motor reports: the torque balance that regressions stand on.

With rotor, stiffness, damping and frictions known, the shaft's torque C, the load's angle, speed and acceleration
are linear filters of the motor's torque and speed (method.md, A1 to A7):

    C = T − J_r ω̇_r − b_r ω_r,   θ_l = θ_r − C/(k + b s),   C − b_l ω_l = J_l ω̇_l + ½ J_l' ω_l²

All are taken through one and the same low-pass without phase, so that none leads another, and the derivatives
are exact within the band. At a constant inertia the balance then holds but for noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.estimation.sdft import ComplexArray
from schwung.motion import Array

#: The pass band ends at, and nothing is left from, so many times the injected frequency.
PASS, STOP = 2.0, 4.0


@dataclass(frozen=True, eq=False)
class LoadSide:
    """At the load, (n,) each, band-limited: torque that accelerates it, how far the shaft is wound up, motion."""

    torque_nm: Array  # C − b_l ω_l
    twist_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array


def load_side(
    machine: Machine, torque_nm: Array, speed_rad_s: Array, sample_rate_hz: float, frequency_hz: float
) -> LoadSide:
    """Reckon the load's side from motor torque and speed, (n,), both band-limited around f_est (Hz)."""
    motor, coupling = machine.motor, machine.coupling
    low_pass = _Filter(torque_nm.size, sample_rate_hz, frequency_hz)
    torque, speed, s = low_pass.spectrum(torque_nm), low_pass.spectrum(speed_rad_s), low_pass.s
    shaft = torque - (motor.inertia_kgm2 * s + motor.viscous_friction_nms) * speed
    twist = np.zeros_like(shaft)
    if coupling is not None:
        twist = shaft / (coupling.stiffness_nm_rad + coupling.damping_nms * s)
    load_speed = speed - s * twist
    return LoadSide(
        torque_nm=low_pass.signal(shaft - machine.load.viscous_friction_nms * load_speed),
        twist_rad=low_pass.signal(twist),
        speed_rad_s=low_pass.signal(load_speed),
        acceleration_rad_s2=low_pass.signal(s * load_speed),
    )


class _Filter:
    """A zero-phase low-pass in the frequency domain; signals are continued to both sides by point reflection."""

    def __init__(self, samples: int, sample_rate_hz: float, frequency_hz: float) -> None:
        self._samples = samples
        self._pad = min(samples - 1, int(2 * sample_rate_hz / frequency_hz))
        self._length = samples + 2 * self._pad
        hertz = np.fft.rfftfreq(self._length, 1 / sample_rate_hz)
        stop = min(STOP * frequency_hz, sample_rate_hz / 2)
        edge = np.clip((hertz / frequency_hz - PASS) / max(stop / frequency_hz - PASS, 1e-9), 0.0, 1.0)
        self._gain = (1 + np.cos(np.pi * edge)) / 2
        self.s = 2j * np.pi * hertz

    def spectrum(self, values: Array) -> ComplexArray:
        pad = self._pad
        before = 2 * values[0] - values[pad:0:-1]
        after = 2 * values[-1] - values[-2 : -pad - 2 : -1]
        return np.asarray(np.fft.rfft(np.concatenate([before, values, after])) * self._gain)

    def signal(self, spectrum: ComplexArray) -> Array:
        return np.asarray(np.fft.irfft(spectrum, self._length)[self._pad : self._pad + self._samples])
