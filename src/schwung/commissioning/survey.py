"""What the drive says about itself before anything moves, and what is to be said about that."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from schwung.commissioning.checks import COMFORT, Check, energised_check, meaning_checks, ready_checks
from schwung.commissioning.plan import Plan
from schwung.commissioning.ways import INJECTED, MOVING, SAMPLED
from schwung.fieldbus.drive import (
    Acquisition,
    BusLoad,
    Capability,
    Drive,
    DriveIdentity,
    DriveLimits,
    DriveState,
    Resolution,
)

MAX_BUS_LOAD = 0.9
#: Ways that some drives offer: that others do not is no news where they are not taken.
_OTHER_WAYS = {*SAMPLED.values(), *INJECTED.values(), "disturbance buffer", "harmonic feed-forward",
               "host-played feed-forward", "lockstep"}  # fmt: skip


@dataclass(frozen=True)
class Survey:
    """What the drive said about itself, read without changing it."""

    identity: DriveIdentity
    state: DriveState
    limits: DriveLimits
    resolution: Resolution
    capabilities: tuple[Capability, ...]
    bus_load: BusLoad


def survey(drive: Drive, plan: Plan) -> Survey:
    """Read everything that preflight looks at; changes nothing in the drive."""
    return Survey(
        identity=drive.identity,
        state=drive.state(),
        limits=drive.limits(),
        resolution=drive.resolution(),
        capabilities=drive.capabilities(),
        bus_load=drive.bus_load(plan.acquisition),
    )


def drive_checks(seen: Survey, way: Acquisition | None = None) -> Iterable[Check]:
    """Identity, state, and what the drive cannot do; what the way needs of that stops (None: setpoints and SYNC)."""
    mode, sampling, injecting = (
        (way.mode, way.sampling, way.injecting) if way else ("csp", "sync", "setpoints")
    )
    needs = ("torque", MOVING[mode], SAMPLED[sampling], INJECTED[injecting])
    identity = seen.identity
    yield Check(
        "identity", "ok", f"node {identity.node_id}: {identity.name or 'unnamed'}, serial {identity.serial}"
    )
    if "fault" in seen.state.cia402.lower():
        yield Check(
            "drive state",
            "stop",
            f"the drive is in {seen.state.cia402}{f' ({seen.state.error})' if seen.state.error else ''}",
            "Mend the cause and reset the fault; Schwung does not do it for you.",
        )
    elif (energised := energised_check(seen.state)) is not None:
        yield energised
    else:
        # the NMT state is told by heartbeats, which a drive need not send yet
        told = [word.lower() for word in (seen.state.nmt, seen.state.cia402)]
        yield Check("drive state", "ok", ", ".join(word for word in told if word != "unknown"))
    yield from ready_checks(seen.state)
    yield from meaning_checks(seen.limits)
    for capability in seen.capabilities:
        needed = capability.name in needs
        if not capability.available and (needed or capability.name not in _OTHER_WAYS):
            yield Check(
                capability.name,
                "stop" if needed else "note",
                f"not available: {capability.reason}",
                "Use a drive or a profile that offers it." if needed else "",
            )


def bus_checks(load: BusLoad) -> Iterable[Check]:
    """Is there room on the bus for the cyclic frames?"""
    text = f"{load.share:.0%} of the bus time for the cyclic frames ({load.basis})"
    if load.share > MAX_BUS_LOAD:
        yield Check("bus load", "stop", text, "Raise the bit rate or lower --rate.")
    else:
        yield Check("bus load", "warning" if load.share > COMFORT else "ok", text)
