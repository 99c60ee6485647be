"""Commissioning as one story: prepare (nothing moves), carry out (the machine moves), judge what came back."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from schwung.commissioning.host_played import HostPlayed
from schwung.commissioning.journal import Change, ParameterJournal
from schwung.commissioning.limits import LimitWishes, limits_of
from schwung.commissioning.plan import Plan, PlannedRun, make_plan
from schwung.commissioning.preflight import Preflight, preflight
from schwung.commissioning.procedure import Observer, Recorded, record
from schwung.commissioning.survey import MAX_BUS_LOAD, Survey, survey
from schwung.commissioning.ways import (
    MAX_JITTER_SHARE,
    ONE_WAY,
    InjectionChoice,
    ModeChoice,
    SamplingChoice,
    Way,
    choose_way,
    require_phases,
)
from schwung.drivetrain import FeedForward, Machine
from schwung.drivetrain.gains import with_control
from schwung.errors import InputError, RefusedError, SchwungError
from schwung.estimation import Estimate, estimate
from schwung.estimation.reach import Reach, reach_of
from schwung.fieldbus.drive import MISSES_ALLOWED, Acquisition, Drive, SyncTiming
from schwung.fieldbus.profile import DeviceProfile, ScaledObject
from schwung.session import Run, Session, read_session


@dataclass(frozen=True)
class Wishes:
    """What the user asked for; None: propose.

    Attributes, numbers without a shape: `distance_rad` (rad, signed) and `duration_s` (s) of one stroke, `limits`,
    `kind` ("third", "poly5", "scurve" or "cosine"), `returns`, `frequency_hz` (Hz) and `amplitude_nm` (N·m) of the
    injected torque, `repeats`, `phases` (1 or 4), `also_s` (s, further times of the stroke), `sample_rate_hz` (Hz), and
    how drive and bus are used: `mode`, `sampling`, `injecting`, `trace_rate_hz` (Hz), `max_jitter_share` of the period,
    `misses_allowed` heartbeats; `start_rad` (rad) where the axis has to stand. Raises nothing itself: `plan` raises
    InputError for wishes that nobody can fulfil.

    >>> schwung.Wishes(distance_rad=3.14, duration_s=0.25, phases=4).limits.torque_max_nm is None
    True
    """

    distance_rad: float
    duration_s: float
    limits: LimitWishes = field(default_factory=LimitWishes)
    kind: str = "third"
    returns: bool = True
    mode: ModeChoice = "auto"
    sampling: SamplingChoice = "auto"
    injecting: InjectionChoice = "auto"
    sample_rate_hz: float = 1000.0
    trace_rate_hz: float | None = None
    frequency_hz: float | None = None
    amplitude_nm: float | None = None
    repeats: int = 2
    phases: int = 1
    also_s: tuple[float, ...] = ()  # further, longer times of the stroke
    max_jitter_share: float = MAX_JITTER_SHARE
    misses_allowed: int = MISSES_ALLOWED  # heartbeats, on both sides
    because: tuple[str, ...] = ()  # where wishes come from that nobody typed
    start_rad: float | None = None  # where the axis has to stand; None: wherever it does


@dataclass(frozen=True, eq=False)
class Prepared:
    """Everything known before the power stage is switched on."""

    plan: Plan
    machine: Machine
    survey: Survey
    preflight: Preflight
    feed_forward: FeedForward
    wishes: Wishes

    @property
    def max_jitter_share(self) -> float:
        """Share of the period by which SYNC may come unevenly."""
        return self.wishes.max_jitter_share


@dataclass(frozen=True, eq=False)
class Commissioned:
    """What commissioning found, and where it lies."""

    prepared: Prepared
    session_path: Path
    session: Session
    recorded: Recorded
    estimate: Estimate
    reach: Reach | None
    contrast: Estimate | None
    changes: tuple[Change, ...]


def read_gains(drive: Drive, profile: DeviceProfile) -> dict[str, float]:
    """The controller gains that the drive holds, SI, by the names of machine.toml; empty where it cannot say."""
    gains = {}
    for name in type(profile.control).model_fields:
        scaled: ScaledObject | None = getattr(profile.control, name)
        if scaled is not None:
            raw = drive.read(drive.parameter(scaled.object.index, scaled.object.subindex)).raw
            if isinstance(raw, int | float):
                gains[name] = raw * scaled.scale
    return gains


def prepare(
    drive: Drive,
    profile: DeviceProfile,
    machine: Machine,
    wishes: Wishes,
    timing: SyncTiming | None = None,
    *,
    estimates: bool = True,
) -> Prepared:
    """Plan and check; reads the drive, changes nothing, moves nothing. `timing`: see `choose_way`; None: it is measured
    where it matters. `estimates`: see `preflight`.

    Raises InputError where limits or beliefs are missing, RefusedError where the axis stands elsewhere than wished;
    what preflight finds is in the result.
    """
    gains = read_gains(drive, profile)
    machine = with_control(machine, gains)
    limits = limits_of(wishes.limits, drive.limits(), machine)
    injected = profile.quantities.torque_added
    way = way_of(drive, profile, wishes, timing)
    require_phases(profile, way, wishes.phases)
    plan = make_plan(
        machine,
        limits,
        start_position_rad=_standing(drive, profile),
        distance_rad=wishes.distance_rad,
        duration_s=wishes.duration_s,
        kind=wishes.kind,
        returns=wishes.returns and way.returns,
        mode=way.mode,
        sample_rate_hz=way.sync_rate_hz,
        frequency_hz=wishes.frequency_hz,
        amplitude_nm=wishes.amplitude_nm,
        repeats=wishes.repeats,
        phases=wishes.phases,
        also_s=wishes.also_s,
        torque_held=injected is None or injected.between_syncs == "held",
        sampling=way.sampling,
        injecting=way.injecting,
        trace=profile.trace,
        trace_rate_hz=wishes.trace_rate_hz,
        generator=profile.generator,
        misses_allowed=wishes.misses_allowed,
    )
    _require_start(plan, wishes)
    one_way = (ONE_WAY,) if wishes.returns and not way.returns else ()
    plan = replace(plan, reasons=(*way.reasons, *one_way, *wishes.because, *plan.reasons))
    forward = FeedForward(speed_share=gains.get("speed_feed_forward", 0.0))
    seen = survey(drive, plan)
    checked = preflight(plan, machine, seen, forward, estimates=estimates)
    return Prepared(plan, machine, seen, checked, forward, wishes)


def _require_start(plan: Plan, wishes: Wishes) -> None:
    """Raise RefusedError where the axis stands further from where it has to than its following error allows."""
    wanted, stands = wishes.start_rad, plan.start_position_rad
    if wanted is not None and not abs(stands - wanted) <= plan.limits.following_error_rad:
        raise RefusedError(
            "plan",
            f"starts at {wanted:.4g} rad, the axis stands at {stands:.4g}",
            "Move the axis there, or have a plan made for where it stands.",
        )


def _standing(drive: Drive, profile: DeviceProfile) -> float:
    """Where the axis stands (rad). Raises InputError where nobody says what a count of its position is worth."""
    position = drive.state().position_rad
    if not math.isfinite(position):
        raise InputError(
            f"profile {profile.family}, quantities.position",
            f"its unit is left to you: {profile.quantities.position.hint or 'the drive does not tell it'}",
            'Write a profile that extends this one, with unit = "literal" and that scale.',
        )
    return position


def way_of(drive: Drive, profile: DeviceProfile, wishes: Wishes, timing: SyncTiming | None = None) -> Way:
    """How this drive on this bus shall be commissioned; `timing` as in `choose_way`.

    Raises InputError for a trace that the profile lacks.
    """
    if timing is None and wishes.mode == "auto":
        timing = drive.measure_sync(wishes.sample_rate_hz)
    fast = drive.bus_load(Acquisition(mode="csp", sample_rate_hz=wishes.sample_rate_hz))
    way = choose_way(
        profile,
        drive.capabilities(),
        wishes.mode,
        wishes.sampling,
        wishes.injecting,
        sync_rate_hz=wishes.sample_rate_hz,
        bus_is_full=fast.share > MAX_BUS_LOAD,
        phases=wishes.phases,
        timing=timing,
        max_jitter_share=wishes.max_jitter_share,
    )
    for wanted, part, name in (
        (way.sampling == "trace", profile.trace, "trace buffer"),
        (way.injecting == "generator", profile.generator, "generator"),
    ):
        if wanted and part is None:
            option = "--sampling" if name == "trace buffer" else "--injection"
            reason = profile.cannot.get(
                "trace buffer" if name == "trace buffer" else "generator", "it has none"
            )
            raise InputError(
                f"profile {profile.family}",
                f"this profile has no {name}: {reason}",
                f"Leave {option} to auto.",
            )
    return way


def settings_of(plan: Plan) -> dict[str, Any]:
    """The plan as stored with the session: what another commissioning needs to do the same again."""
    limits = plan.limits
    return {
        "mode": plan.acquisition.mode,
        "sampling": plan.acquisition.sampling,
        "injecting": plan.acquisition.injecting,
        "sync_rate_hz": plan.acquisition.sample_rate_hz,
        "trace_rate_hz": plan.acquisition.trace_rate_hz,
        "start_position_rad": plan.start_position_rad,
        "limits": {
            "position_min_rad": limits.position_min_rad,
            "position_max_rad": limits.position_max_rad,
            "speed_max_rad_s": limits.speed_max_rad_s,
            "torque_max_nm": limits.torque_max_nm,
            "following_error_rad": limits.following_error_rad,
        },
        "reasons": list(plan.reasons),
    }


def control_of(machine: Machine) -> dict[str, Any]:
    """The gains as stored with the session, for estimates made later; see `with_recorded_gains`."""
    return {"control": machine.required_control().model_dump(by_alias=True)}


def carry_out(
    drive: Drive,
    prepared: Prepared,
    out: Path,
    observer: Observer,
    max_jitter_share: float = MAX_JITTER_SHARE,
) -> Commissioned:
    """Move, record, estimate. The session lies in `out` run by run; parameters are back when this returns.

    Raises RefusedError, DriveError, InterruptedByUser as `record` does, InputError where the recording allows no
    estimate (it is kept).
    """
    kept = record_prepared(drive, prepared, out, observer, max_jitter_share)
    observer.phase("Estimating the load inertia")
    session = read_session(kept.session_path)
    found = estimate(session, prepared.machine)
    return Commissioned(
        prepared=prepared,
        session_path=kept.session_path,
        session=session,
        recorded=kept.recorded,
        estimate=found,
        reach=reach_of(session, prepared.machine, found),
        contrast=contrast_of(session, prepared.machine),
        changes=kept.changes,
    )


@dataclass(frozen=True, eq=False)
class KeptSession:
    """What was recorded, where it lies, and which parameters were changed for it."""

    session_path: Path
    recorded: Recorded
    changes: tuple[Change, ...]


def record_prepared(
    drive: Drive,
    prepared: Prepared,
    out: Path,
    observer: Observer,
    max_jitter_share: float = MAX_JITTER_SHARE,
) -> KeptSession:
    """The part of `carry_out` that needs the drive: move and record; raises as `record` does."""
    session_path = out / "session.h5"
    journal = ParameterJournal(drive, out / "setup.backup.json", drive.describe())
    recorded = record(
        drive,
        prepared.plan,
        prepared.preflight,
        session_path=session_path,
        journal=journal,
        observer=observer,
        settings=settings_of(prepared.plan) | control_of(prepared.machine),
        max_jitter_share=max_jitter_share,
    )
    return KeptSession(session_path, recorded, journal.changes)


def contrast_of(session: Session, machine: Machine) -> Estimate | None:
    """The former method on the same session, as published: it looks for no delay. None where it finds nothing, which is
    part of the contrast.
    """
    try:
        return estimate(session, machine, method="former", remove_delay=False)
    except SchwungError:
        return None


def repeat_reference(
    drive: Drive,
    prepared: Prepared,
    out: Path,
    name: str,
    observer: Observer,
    played: HostPlayed | None = None,
) -> Run:
    """Make the reference motion once more, as before or after an export, into `out/name.h5`; returns the run.

    `played`: with this feed-forward beside the setpoints; the motion is simulated with it before it is made.
    """
    journal = ParameterJournal(drive, out / f"{name}.backup.json", drive.describe())
    plan = replace(prepared.plan, repeats=1)
    only = (PlannedRun("reference", 0, plan.motion, None, played=played),)
    ready = prepared.preflight if played is None else _preflight_played(prepared, plan, played)
    recorded = record(
        drive,
        plan,
        replace(ready, creep=None),  # signs and units were proven when it was measured
        session_path=out / f"{name}.h5",
        journal=journal,
        observer=observer,
        settings=settings_of(plan),
        runs=only,
        max_jitter_share=prepared.max_jitter_share,
    )
    return recorded.runs[0]


def _preflight_played(prepared: Prepared, plan: Plan, played: HostPlayed) -> Preflight:
    """The checks anew, for the machine as measured and with the torque that is going to be played."""
    load = prepared.machine.load.model_copy(
        update={"inertia_kgm2": None, "inertia_table": played.load_inertia}
    )
    machine = prepared.machine.model_copy(update={"load": load})
    forward = replace(prepared.feed_forward, inertia=played.load_inertia)
    return preflight(plan, machine, prepared.survey, forward, estimates=False)


def wishes_of(session: Session) -> Wishes:
    """The wishes that lead to a recorded session's motion again, within the limits that it had.

    Raises InputError where the session was not recorded by Schwung.
    """
    settings = (session.drive or {}).get("settings") or {}
    motion = next((run.motion for run in session.references if run.motion is not None), None)
    try:
        limits = LimitWishes(**settings["limits"])
        mode: ModeChoice = "pp" if settings["mode"] == "pp" else "csp"
    except (KeyError, TypeError):
        limits, mode = None, "csp"
    sampling: SamplingChoice = "trace" if settings.get("sampling") == "trace" else "sync"
    injecting: InjectionChoice = "generator" if settings.get("injecting") == "generator" else "setpoints"
    if motion is None or limits is None:
        raise InputError(
            "session",
            "does not say which motion was made within which limits",
            "Take one that Schwung recorded.",
        )
    return Wishes(
        distance_rad=motion.distance_rad,
        duration_s=motion.duration_s,
        limits=limits,
        kind=motion.kind,
        returns=motion.returns,
        mode=mode,
        sampling=sampling,
        injecting=injecting,
        sample_rate_hz=settings.get("sync_rate_hz") or session.references[0].sample_rate_hz,
        trace_rate_hz=settings.get("trace_rate_hz"),
    )
