"""The best motion on the machine: the reference and the optimised motion in turn, through preflight, creep and limits.

Planned, checked and recorded by the procedure of every other motion; the torque beside the setpoints is the plan's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from schwung.commissioning.commission import read_gains, settings_of
from schwung.commissioning.creep import creep_of
from schwung.commissioning.guarding import guard_of, travel_of
from schwung.commissioning.host_played import HostPlayed
from schwung.commissioning.journal import ParameterJournal
from schwung.commissioning.limits import Limits, LimitWishes, limits_of
from schwung.commissioning.plan import Plan, PlannedRun, TorqueAlong, believed_inertia_range, make_plan
from schwung.commissioning.preflight import (
    FINER,
    Preflight,
    motion_checks,
    simulated_run,
    standing_checks,
)
from schwung.commissioning.procedure import Observer, Recorded, record
from schwung.commissioning.survey import survey
from schwung.commissioning.ways import MAX_JITTER_SHARE
from schwung.drivetrain import FeedForward, InertiaTable, Machine, Simulated
from schwung.drivetrain.gains import with_control
from schwung.errors import InputError
from schwung.fieldbus.drive import Drive
from schwung.fieldbus.profile import DeviceProfile
from schwung.motion import Motion


@dataclass(frozen=True)
class PlayPlan(Plan):
    """A plan whose runs are the reference and the optimised motion in turn, none of them excited.

    The reference gets the torque that a drive makes of the measured table, so that what is saved is the motion's.
    """

    optimised: Motion | None = None
    torque: TorqueAlong | None = None
    reference_torque: TorqueAlong | None = None

    def runs(self) -> Iterator[PlannedRun]:
        """Reference first; both as often as repeated."""
        assert self.optimised is not None
        for repeat in range(self.repeats):
            yield PlannedRun("reference", repeat, self.motion, None, torque=self.reference_torque)
            yield PlannedRun("reference", repeat, self.optimised, None, torque=self.torque)


@dataclass(frozen=True, eq=False)
class PlayPrepared:
    """Everything known before the power stage is switched on."""

    plan: PlayPlan
    machine: Machine
    preflight: Preflight
    max_jitter_share: float

    @property
    def predicted(self) -> tuple[Simulated, Simulated]:
        """Reference and optimised motion as simulated, sampled as the drive reports them: see `preflight._sampled`."""
        return _reported(self.preflight.reference), _reported(self.preflight.excited)


@dataclass(frozen=True, eq=False)
class Stand:
    """Where the axis stands, what holds for it, and the machine with the gains that the drive has."""

    start_rad: float
    limits: Limits
    machine: Machine
    feed_forward: FeedForward


def stand_of(drive: Drive, profile: DeviceProfile, machine: Machine, wishes: LimitWishes) -> Stand:
    """What has to be known of the drive before a motion for it can be found. Reads, changes nothing.

    Raises InputError where limits are missing, or the drive adds a torque of its own already.
    """
    gains = read_gains(drive, profile)
    machine = with_control(machine, gains)
    _require_no_own_torque(drive, profile)
    forward = FeedForward(speed_share=gains.get("speed_feed_forward", 0.0))
    return Stand(drive.state().position_rad, limits_of(wishes, drive.limits(), machine), machine, forward)


def _require_no_own_torque(drive: Drive, profile: DeviceProfile) -> None:
    """Torque of the drive's own feed-forward would come on top of ours."""
    for form in ("table", "scalar"):
        target = getattr(profile.export, form)
        enable = None if target is None else target.enable
        if enable is None:
            continue
        held = drive.read(drive.parameter(enable.object.index, enable.object.subindex))
        if held.raw == enable.value:
            raise InputError(
                held.parameter.label,
                "is on: the drive adds a torque by its own inertia, and ours would come on top",
                "Put it back (schwung restore export.backup.json), play, and export again.",
            )


def prepare_play(
    drive: Drive,
    profile: DeviceProfile,
    stand: Stand,
    reference: Motion,
    optimised: Motion,
    torque: TorqueAlong,
    *,
    repeats: int = 3,
    sample_rate_hz: float = 1000.0,
    max_jitter_share: float = MAX_JITTER_SHARE,
) -> PlayPrepared:
    """Plan and check both motions; changes nothing, moves nothing. What preflight finds is in the result.

    `reference` says kind and duration. Raises InputError for a motion that cannot be planned.
    """
    injected = profile.quantities.torque_added
    if injected is None:
        raise InputError(
            f"profile {profile.family}",
            profile.reason("torque injection"),
            "Take the motion to the controller instead: setpoints.csv, or a cam.",
        )
    base = make_plan(
        stand.machine,
        stand.limits,
        start_position_rad=stand.start_rad,
        distance_rad=reference.distance_rad,
        duration_s=reference.duration_s,
        kind=reference.kind,
        repeats=repeats,
        sample_rate_hz=sample_rate_hz,
        torque_held=injected.between_syncs == "held",
    )
    timing = {"start_time_s": base.motion.start_time_s, "dwell_s": base.motion.dwell_s, "returns": True}
    plan = PlayPlan(
        **{name: getattr(base, name) for name in base.__dataclass_fields__},
        optimised=optimised.model_copy(update=timing),
        torque=torque,
        reference_torque=_by_the_table(stand, base.motion.distance_rad),
    )
    assert plan.optimised is not None
    largest = believed_inertia_range(stand.machine)[1]
    guard = guard_of(
        stand.machine,
        stand.limits,
        (plan.motion, plan.optimised),
        (plan.excitation,),
        travel_of([(stand.start_rad, plan.motion)]),
        largest,
    )
    plan = replace(plan, acquisition=replace(plan.acquisition, guard=guard), reasons=())
    return PlayPrepared(plan, stand.machine, _preflight(drive, plan, stand), max_jitter_share)


def _by_the_table(stand: Stand, distance_rad: float) -> TorqueAlong:
    """What a drive adds that holds the measured inertia: (J_r + J_l(θ*)) α* + ½ J_l'(θ*) ω*²."""
    inertia = stand.machine.load_inertia
    if not isinstance(inertia, InertiaTable):
        ends = np.sort([stand.start_rad, stand.start_rad + distance_rad])
        inertia = InertiaTable(ends, stand.machine.load_inertia_at(ends))
    held = HostPlayed(inertia, stand.machine.motor.inertia_kgm2)
    return lambda motion, time: held.torque(motion.demand(time), stand.start_rad)


def _preflight(drive: Drive, plan: PlayPlan, stand: Stand) -> Preflight:
    seen = survey(drive, plan)
    first = [run for run in plan.runs() if run.repeat == 0]
    reference, optimised = (simulated_run(run, plan, stand.machine, stand.feed_forward) for run in first)
    creep = creep_of(plan, stand.machine, seen.resolution)
    small = creep.motions(plan) if creep is not None else ()
    others = [simulated_run(run, plan, stand.machine, stand.feed_forward) for run in small]
    checks = [
        *standing_checks(plan, stand.machine, seen),
        *motion_checks(plan, (reference, optimised, *others)),
    ]
    return Preflight(tuple(checks), "drive", reference, optimised, None, creep)


def _reported(simulated: Simulated) -> Simulated:
    """A simulated run as SYNC samples it: angle and speed at SYNC, torque as its mean over the cycle before."""
    at = slice(FINER, None, FINER)
    count = (simulated.time_s.size - 1) // FINER
    torque = np.mean(simulated.torque_nm[: count * FINER].reshape(count, FINER), axis=1)
    return replace(
        simulated,
        time_s=simulated.time_s[at],
        demand_position_rad=simulated.demand_position_rad[at],
        position_rad=simulated.position_rad[at],
        speed_rad_s=simulated.speed_rad_s[at],
        torque_nm=torque,
        load_position_rad=simulated.load_position_rad[at],
        load_speed_rad_s=simulated.load_speed_rad_s[at],
        clipped=simulated.clipped[at],
    )


def play(drive: Drive, prepared: PlayPrepared, out: Path, observer: Observer) -> Recorded:
    """Creep, then both motions in turn; runs alternate between reference and optimised, and lie in `out/played.h5`.

    Raises RefusedError, DriveError, InterruptedByUser as `record` does.
    """
    journal = ParameterJournal(drive, out / "play.backup.json", drive.describe())
    return record(
        drive,
        prepared.plan,
        prepared.preflight,
        session_path=out / "played.h5",
        journal=journal,
        observer=observer,
        settings=settings_of(prepared.plan),
        max_jitter_share=prepared.max_jitter_share,
        source="schwung optimise --play",
    )
