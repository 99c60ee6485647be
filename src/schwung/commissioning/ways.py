"""Which way a drive is commissioned: who moves, who injects, who samples. What nobody asked for follows from what
profile and drive offer, and each choice has its reason.

On a fast bus everything goes over SYNC: setpoints, injection and samples. Where drive or bus cannot do that, the drive
does the fast part itself: it makes its own trapezoid, its own sine and its own trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from schwung.errors import InputError
from schwung.fieldbus.drive import Capability, Injecting, OperatingMode, Sampling, SyncTiming
from schwung.fieldbus.profile import DeviceProfile

ModeChoice = Literal["auto", "csp", "pp"]
SamplingChoice = Literal["auto", "sync", "trace"]
InjectionChoice = Literal["auto", "setpoints", "generator"]

#: What each part of a way needs of the drive, by the names of capabilities.
MOVING: dict[OperatingMode, str] = {"csp": "cyclic position", "pp": "profile position"}
SAMPLED: dict[Sampling, str] = {"sync": "sampling by SYNC", "trace": "trace buffer"}
INJECTED: dict[Injecting, str] = {"setpoints": "torque injection", "generator": "generator"}
#: SYNC of a drive that moves, injects and samples by itself: often enough to see a fault, and no load for any bus.
SLOW_SYNC_HZ = 100.0
#: SYNC that comes less evenly than this (99th percentile, share of the period) decides setpoints by chance.
MAX_JITTER_SHARE = 0.1
#: A mean SYNC rate that is off by more is worth a word: no computer's clock is, and the table is off by up to twice.
MAX_RATE_ERROR = 1e-3


@dataclass(frozen=True)
class Way:
    """Who moves, who samples, who injects; and why, where nobody said."""

    mode: OperatingMode
    sampling: Sampling
    injecting: Injecting
    sync_rate_hz: float
    reasons: tuple[str, ...] = ()
    returns: bool = True  # strokes there and back can be one motion


def comes_unevenly(timing: SyncTiming, max_share: float = MAX_JITTER_SHARE) -> bool:
    """Whether SYNC misses its grid by more than that share of a period. A drive clocked by SYNC (lockstep) has none."""
    return timing.producer != "lockstep" and timing.p99_s > max_share * timing.period_s


def off_rate(timing: SyncTiming, rate_hz: float) -> str | None:
    """What to say where SYNC came at another mean rate than asked for; None where it did not.

    Setpoints are played and samples taken by SYNC, so that speeds and the injected frequency are off by the share and
    accelerations by its square, while samples count as taken at `rate_hz` (Hz).
    """
    share = 1 / (timing.period_s * rate_hz) - 1
    if timing.producer == "lockstep" or abs(share) <= MAX_RATE_ERROR:
        return None
    return (
        f"SYNC came at {rate_hz * (1 + share):.5g} Hz instead of {rate_hz:g} Hz: inertias are off by up "
        f"to {2 * abs(share):.1%}. Lower --rate, or take load off this computer"
    )


def choose_way(
    profile: DeviceProfile,
    capabilities: Sequence[Capability],
    mode: ModeChoice = "auto",
    sampling: SamplingChoice = "auto",
    injecting: InjectionChoice = "auto",
    *,
    sync_rate_hz: float = 1000.0,
    bus_is_full: bool = False,
    phases: int = 1,
    timing: SyncTiming | None = None,
    max_jitter_share: float = MAX_JITTER_SHARE,
) -> Way:
    """Fill in what is left to us. `bus_is_full`: SYNC at that rate would take more of the bus than there is. `timing`:
    how evenly it comes, measured with the power stage off; None: not measured.

    Where SYNC comes too unevenly, the drive makes the motion itself; and injects and samples itself, where it can.
    Never raises for what the drive lacks: preflight says that, of whichever way is taken.
    """
    told = {capability.name: capability for capability in capabilities}
    own_parts = {"trace buffer": profile.trace, "generator": profile.generator}

    def lacks(name: str) -> str | None:
        """Why it cannot be had; None where it can."""
        if name in told and not told[name].available:
            return told[name].reason
        if name == "trace buffer" and profile.trace is not None:
            if profile.trace.trigger != "motion_start":
                return "its trace starts when it is armed, not with the motion"
            columns = {column.quantity for column in profile.trace.columns}
            missing = {"position", "torque"} - columns
            return f"its trace records no {' and no '.join(sorted(missing))}" if missing else None
        return "the profile has none" if name in own_parts and own_parts[name] is None else None

    reasons = []
    own = ("profile position", "trace buffer", "generator")
    asked = mode == "csp" or sampling == "sync" or injecting == "setpoints"
    uneven = None
    if timing is not None and comes_unevenly(timing, max_jitter_share):
        off_ms, period_ms = timing.p99_s * 1e3, timing.period_s * 1e3
        uneven = f"SYNC is off by {off_ms:.2g} ms of a {period_ms:.3g} ms period on this adapter"
    if (bus_is_full or uneven) and not asked and not any(lacks(name) for name in own):
        why = f"SYNC at {sync_rate_hz:g} Hz would overload this bus" if bus_is_full else uneven
        rate = min(SLOW_SYNC_HZ, sync_rate_hz)
        reasons.append(f"the drive moves, injects and samples by itself, SYNC comes at {rate:g} Hz: {why}")
        return Way("pp", "trace", "generator", rate, tuple(reasons))
    if mode == "auto":
        why = lacks(MOVING["csp"]) or uneven
        mode = "csp" if why is None or lacks(MOVING["pp"]) else "pp"
        if mode == "pp":
            reasons.append(f"the drive makes its own profile (PP): no setpoints over the bus ({why})")
    if sampling == "auto":
        why = lacks(SAMPLED["sync"])
        sampling = "sync" if why is None or lacks(SAMPLED["trace"]) else "trace"
        if sampling == "trace":
            reasons.append(f"the drive's trace buffer samples: none by SYNC ({why})")
    if injecting == "auto":
        why = lacks(INJECTED["setpoints"])
        cannot = lacks(INJECTED["generator"]) or _no_phases(profile, phases)
        injecting = "setpoints" if cannot or (why is None and sampling == "sync") else "generator"
        if injecting == "generator":
            steps = "its sine has no steps from SYNC to SYNC, which a trace would see"
            reasons.append(
                f"the drive's generator injects: {steps if why is None else f'no torque over the bus ({why})'}"
            )
    return Way(mode, sampling, injecting, sync_rate_hz, tuple(reasons), profile.protocol != "modbus")


#: Why the way back is not recorded where `Way.returns` is false.
ONE_WAY = "one way is measured: each stroke is started by a request, whose instant over Modbus is not exact"


def require_phases(profile: DeviceProfile, way: Way, phases: int) -> None:
    """Raise InputError where the generator cannot be given several phases that are known at the motion's start."""
    why = _no_phases(profile, phases) if way.injecting == "generator" else None
    if why is not None:
        raise InputError("--phases", f"is {phases}, but {why}", "Use --phases 1, or --injection setpoints.")


def _no_phases(profile: DeviceProfile, phases: int) -> str | None:
    """Why the generator cannot make so many phases; None where it can."""
    generator = profile.generator
    if phases == 1 or generator is None:
        return None
    if generator.control.at_motion is not None and generator.phase is not None:
        return None
    return f"the generator of {profile.family} cannot start with the motion at a phase that is set"
