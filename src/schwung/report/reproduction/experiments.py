"""The paper's experiments, repeated on its simulated machine: recordings, estimates and how far off they are.

The machine is Table 1 with the control gains of the paper's simulation, sampled at 8 kHz, with the noise of our
feasibility study (method.md). Its load inertia is *inferred*: the paper only draws it (Fig. 8).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from schwung.drivetrain import (
    InertiaTable,
    Machine,
    disturbance_to_position_ratio,
    paper_machine,
    simulate,
)
from schwung.estimation import Estimate, Inversion, estimate
from schwung.motion import Array, Excitation, Motion, MotionKind
from schwung.session import Run, Session

RATE_HZ = 8000.0  # 125 µs; the paper prints "ms"
SPEED_NOISE_RAD_S = 0.02
TORQUE_NOISE_NM = 0.1
STROKE_RAD = np.pi
RAMP_S = 0.04
TABLE_POINTS = 181
#: What stands for "not limited": several times what the fastest motion here needs (N·m).
UNLIMITED_NM = 2000.0


@dataclass(frozen=True)
class Case:
    """One motion with one injection. `limited`: the drive clips at T_max. `noise`: how many times the usual."""

    duration_s: float
    frequency_hz: float = 50.0
    share: float = 0.2  # |T_add| over T_max
    kind: MotionKind = "third"
    limited: bool = True
    start_s: float = 0.2
    noise: float = 1.0

    @property
    def motion(self) -> Motion:
        """One stroke over half a turn, with rest enough for the filters on both sides."""
        return Motion(
            kind=self.kind,
            distance_rad=STROKE_RAD,
            duration_s=self.duration_s,
            start_time_s=self.start_s,
            dwell_s=max(0.3, self.start_s),
            returns=False,
        )

    @property
    def excitation(self) -> Excitation:
        """The injected sine, all through the run but for its ramps."""
        return Excitation(
            frequency_hz=self.frequency_hz,
            amplitude_nm=self.share * paper_machine().motor.peak_torque_nm,
            ramp_s=RAMP_S,
            end_s=self.motion.total_s,
        )


@dataclass(frozen=True)
class Errors:
    """Estimate minus truth over the angles of the stroke, equally spaced (kg·m²)."""

    rmse_kgm2: float
    sigma_kgm2: float
    max_kgm2: float

    def __str__(self) -> str:
        return f"RMSE {self.rmse_kgm2:.4f}, σ {self.sigma_kgm2:.4f}, max {self.max_kgm2:.4f} kg·m²"


@dataclass(frozen=True, eq=False)
class Result:
    """An estimate beside the truth. `error_kgm2` is at `position_rad`, (m,) both."""

    estimate: Estimate
    position_rad: Array
    error_kgm2: Array

    @property
    def errors(self) -> Errors:
        """The statistics of Table 2."""
        error = self.error_kgm2
        rmse, worst = float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error)))
        return Errors(rmse, float(np.std(error)), worst)

    @property
    def miv_kgm2(self) -> float:
        """Maximum inertia variation (15)."""
        return self.estimate.trust.miv_kgm2


def machine(limited: bool = True) -> Machine:
    """The paper's machine; not `limited`: with a motor that never clips."""
    believed = paper_machine()
    if limited:
        return believed
    motor = believed.motor.model_copy(update={"peak_torque_nm": UNLIMITED_NM})
    return believed.model_copy(update={"motor": motor})


def truth() -> InertiaTable:
    """The load inertia that the simulation has, inferred."""
    table = paper_machine().load_inertia
    assert isinstance(table, InertiaTable)
    return table


def recorded(
    believed: Machine,
    motion: Motion,
    excitation: Excitation | None,
    *,
    seed: int,
    start_rad: float = 0.0,
    noise: float = 1.0,
) -> Run:
    """Simulate one run as a drive records it.

    The simulated drive holds each torque for 125 µs; the recorded sample is the mean of the step that ends and the
    step that begins with it, as a current measured all the time would be, so that it belongs to the speed's instant.
    """
    time = motion.time(RATE_HZ)
    added = np.zeros_like(time) if excitation is None else excitation.torque(time)
    simulated = simulate(believed, motion.demand(time), time, added, start_rad=start_rad)
    torque = simulated.torque_nm
    normal = np.random.default_rng([seed, excitation is not None]).normal
    return Run(
        role="reference" if excitation is None else "excited",
        repeat=0,
        sample_rate_hz=RATE_HZ,
        time_s=time,
        position_rad=simulated.position_rad,
        speed_rad_s=simulated.speed_rad_s + noise * SPEED_NOISE_RAD_S * normal(size=time.size),
        torque_nm=np.concatenate([torque[:1], (torque[1:] + torque[:-1]) / 2])
        + noise * TORQUE_NOISE_NM * normal(size=time.size),
        torque_added_nm=added,
        motion=motion,
        excitation=excitation,
        name="reference" if excitation is None else "excited",
    )


@cache
def session_of(case: Case) -> Session:
    """The reference run and the excited run of a case."""
    seed, believed = round(1e4 * case.duration_s), machine(case.limited)
    runs = tuple(
        recorded(believed, case.motion, sine, seed=seed, noise=case.noise) for sine in (None, case.excitation)
    )
    return Session(runs, created="2024-04-09T00:00:00+00:00", source="simulation of the paper's machine")


@cache
def result_of(case: Case, method: str = "denoised", inversion: Inversion = "magnitude") -> Result:
    """Estimate a case; the magnitude inversion is the paper's, (6) put right."""
    found = estimate(
        session_of(case),
        machine(case.limited),
        method,
        inversion,
        points=TABLE_POINTS,
        remove_delay=False,  # which the paper does not know
    )
    table = found.table
    inside = (table.position_rad >= 0) & (table.position_rad <= STROKE_RAD)
    position = table.position_rad[inside]
    return Result(found, position, table.inertia_kgm2[inside] - truth().at(position))


def dpr_of(case: Case, inertia_kgm2: float) -> float:
    """Disturbance-to-position ratio (7) of a case at one inertia."""
    ratio = disturbance_to_position_ratio(
        machine(),
        inertia_kgm2,
        distance_rad=STROKE_RAD,
        duration_s=case.duration_s,
        frequency_hz=case.frequency_hz,
        amplitude_nm=case.excitation.amplitude_nm,
    )
    return float(ratio)


def routh_limit_kgm2(position_gain_per_s: float, speed_gain_nms: float, integral_time_s: float) -> float:
    """The largest J_r + J_l that a cascade keeps stable, coupling taken as rigid (Routh).

    J s³ + (K_ps + b) s² + K_ps (K_pp + 1/T_n) s + K_ps K_pp/T_n, b = b_r + b_l, has its roots on the left where
    J < (K_ps + b)(T_n + 1/K_pp).
    """
    believed = paper_machine()
    friction = believed.motor.viscous_friction_nms + believed.load.viscous_friction_nms
    return (speed_gain_nms + friction) * (integral_time_s + 1 / position_gain_per_s)
