"""The procedure: set up, enable, move without and with the injected sine, record, and leave the drive as it was.

The only place that moves a machine. Whatever happens between set-up and the end (Ctrl-C, a lost node, a defect of
ours) passes through `powered`: quick stop, power stage off, parameters put back. What was recorded is on disk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from schwung.commissioning.checks import energised_check, ready_checks
from schwung.commissioning.creep import Creep, prove
from schwung.commissioning.interrupts import OneInterrupt
from schwung.commissioning.journal import ParameterJournal
from schwung.commissioning.plan import Plan, PlannedRun, setpoints_of
from schwung.commissioning.preflight import Preflight, SpeedSource
from schwung.commissioning.runs import run_of
from schwung.commissioning.ways import MAX_JITTER_SHARE, comes_unevenly, off_rate
from schwung.errors import (
    CoastingError,
    DriveError,
    EnergisedError,
    InterruptedByUser,
    RefusedError,
    SampleLossError,
)
from schwung.fieldbus.drive import Drive, Recording, SyncTiming, partial_recording
from schwung.session import Run, SessionWriter

#: A motion whose recording has gaps is made again so often, then the bus is called unfit.
MAX_RETRIES = 2
#: Strokes that start more unevenly than this are not one motion.
UNEVEN_START_S = 2e-4

#: Shorter pieces of a recording are not worth keeping.
MIN_PARTIAL_SAMPLES = 3


class Observer(Protocol):
    """Who is told how far things are: any object with these three methods.

    `phase`: what is done next, in words; `progress`: samples done of all (a count: no unit, no shape); `note`: what is
    worth knowing and stops nothing. What a method raises ends the procedure as an interrupt does: the drive is stopped.

    >>> class Printing:
    ...     def phase(self, text): print(text)
    ...     def progress(self, done, total): pass
    ...     def note(self, text): print(text)
    >>> Printing().phase("Creep: signs and units")
    Creep: signs and units
    """

    def phase(self, text: str) -> None: ...

    def progress(self, done: int, total: int) -> None: ...

    def note(self, text: str) -> None: ...


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a recording procedure leaves behind."""

    runs: tuple[Run, ...]
    timing: tuple[SyncTiming, ...]
    retries: int


@contextmanager
def powered(drive: Drive, plan: Plan, journal: ParameterJournal, interrupt: OneInterrupt) -> Iterator[None]:
    """A drive that is set up and enabled inside the block, and stopped, off and as before after it.

    `interrupt` is entered already, and for longer: what became of the motions has to be told, too. A drive that
    somebody else has switched on since preflight is left alone: RefusedError, or EnergisedError where that was while it
    was set up.
    """
    foreign = energised_check(drive.state())
    if foreign is not None:
        raise RefusedError(foreign.name, foreign.text, foreign.remedy)
    try:
        journal.change(drive.setup(plan.acquisition))
        drive.start(plan.acquisition)
        _require_ready(drive)
        drive.enable()
        yield
        interrupt.hold_off()  # within: an interrupt that comes first takes the way out below
    except EnergisedError as error:  # no command of ours has gone out: neither halt nor parameters are
        interrupt.hold_off()
        with suppress(DriveError):
            drive.stop()
        if journal.changes:
            error.add_note(
                f"Its parameters are not put back: run `schwung restore {journal.path}` when it is off."
            )
        raise
    except BaseException as error:
        interrupt.hold_off()
        drive.halt()
        for trouble in _leave(drive, journal):
            error.add_note(trouble)
        raise
    troubles = _leave(drive, journal)
    if troubles:
        left = DriveError("leaving the drive", troubles[0])
        for further in troubles[1:]:
            left.add_note(further)
        raise left
    interrupt.let_through()


def _require_ready(drive: Drive) -> None:
    """Look again, now that the node is operational; raises RefusedError while the power stage is still off."""
    for check in ready_checks(drive.state()):
        if check.severity == "stop":
            raise RefusedError(check.name, check.text, check.remedy)


def _leave(drive: Drive, journal: ParameterJournal) -> list[str]:
    """Power off, PDO exchange off, parameters back: each tried whatever became of the one before.

    But for parameters of a drive that may still be on: it would lose its watch over us, and how it stops when we are
    gone. It is tried once more to switch that off, without PDOs.
    """
    troubles: list[str] = []

    def restore() -> None:
        if troubles:
            drive.disable()
        journal.restore()

    steps: list[tuple[str, Callable[[], None]]] = [
        ("the power stage may still be on", drive.disable),
        ("the PDO exchange may still be on", drive.stop),
        (f"parameters are not put back: run `schwung restore {journal.path}`", restore),
    ]
    for consequence, step in steps:
        try:
            step()
        except CoastingError as error:
            troubles.append(str(error))
        except Exception as error:  # a defect of ours, too, may not keep the next step from being tried
            troubles.append(f"{consequence} ({error})")
    return troubles


def record(
    drive: Drive,
    plan: Plan,
    ready: Preflight,
    *,
    session_path: Path,
    journal: ParameterJournal,
    observer: Observer,
    settings: dict[str, Any] | None = None,
    max_jitter_share: float = MAX_JITTER_SHARE,
    runs: tuple[PlannedRun, ...] | None = None,
    source: str = "schwung commission",
) -> Recorded:
    """Carry out a plan, where preflight has one after its creep; each run is on disk before the next one starts.

    Raises RefusedError before anything moves where preflight says stop, and after the creep where that did not prove
    signs and units; DriveError and InterruptedByUser after the drive has been stopped, with complete runs and the part
    of the last one in the session file.
    """
    ready.require()
    planned_runs = tuple(plan.runs()) if runs is None else runs
    described = {**drive.describe(), "settings": settings or {}}
    recorded: list[Run] = []
    timing: list[SyncTiming] = []
    retries = 0
    created = datetime.fromtimestamp(drive.clock.date(), UTC).isoformat(timespec="seconds")
    with (
        OneInterrupt() as interrupt,
        SessionWriter(session_path, source=source, drive=described, created=created) as writer,
    ):
        try:
            observer.phase("Setting up and enabling the drive")
            with powered(drive, plan, journal, interrupt):
                player = _Player(
                    drive, plan, writer, ready.speed_source, observer, interrupt, max_jitter_share
                )
                if ready.creep is not None:
                    observer.phase("Creep: signs and units")
                    player.creep(ready.creep)
                for number, planned in enumerate(planned_runs):
                    observer.phase(f"Motion {number + 1} of {len(planned_runs)}: {planned.role}")
                    after = planned_runs[number + 1 : number + 2]
                    run, sync = player.record(
                        planned, plan.start_of(after[0]) if after else plan.start_position_rad
                    )
                    recorded.append(run)
                    timing.append(sync)
                    retries = player.retries
        except KeyboardInterrupt as error:
            interrupted = InterruptedByUser(
                "interrupted",
                f"the drive was stopped; {len(recorded)} of {len(planned_runs)} motions are in {session_path}",
            )
            for note in getattr(error, "__notes__", []):
                interrupted.add_note(note)
            raise interrupted from error
        except DriveError as error:
            error.add_note(f"{len(recorded)} of {len(planned_runs)} motions are in {session_path}")
            raise
    return Recorded(tuple(recorded), tuple(timing), retries)


@dataclass
class _Player:
    """Plays planned runs one by one, each on disk before the axis moves again."""

    drive: Drive
    plan: Plan
    writer: SessionWriter
    source: SpeedSource
    observer: Observer
    interrupt: OneInterrupt
    max_jitter_share: float
    retries: int = 0

    def record(self, planned: PlannedRun, next_start_rad: float) -> tuple[Run, SyncTiming]:
        """Play one run, again where samples were lost; raises SampleLossError when that does not help.

        A one-way run is undone where it, or what follows, starts where it began.
        """
        start, back = self.plan.start_of(planned), self.plan.way_back(planned)
        recording = self._play_whole(planned)
        for note in recording.notes:
            self.observer.note(note)
        try:
            if self.plan.by_itself:
                self._warn_of_way_back(recording.timing)
            else:
                _judge_timing(recording.timing, self.max_jitter_share)
                if said := off_rate(recording.timing, recording.sample_rate_hz):
                    self.observer.note(said)
        except DriveError as error:
            self._keep_partial(recording, planned, str(error))
            raise
        run = run_of(recording, planned, self.plan, self.source)
        self.writer.append(run)
        if next_start_rad == start:
            self._go(back)
        return run, recording.timing

    def creep(self, creep: Creep) -> None:
        """Prove signs and units; raises RefusedError where they are not what is believed, DriveError where SYNC came so
        unevenly that time may be what is off.
        """
        timings: list[SyncTiming] = []

        def play(planned: PlannedRun) -> Recording:
            recording = self._play_whole(planned)
            timings.append(recording.timing)
            return recording

        try:
            notes = prove(
                self.drive,
                self.plan,
                creep,
                play,
                lambda planned: self._go(self.plan.way_back(planned)),
                self.writer.append_creep,
            )
        except RefusedError:
            if timings and not self.plan.by_itself:
                _judge_timing(timings[-1], self.max_jitter_share)
            raise
        for note in notes:
            self.observer.note(note)

    def _play_whole(self, planned: PlannedRun) -> Recording:
        """Play one run, again where samples were lost; raises SampleLossError when that does not help."""
        for attempt in range(MAX_RETRIES + 1):
            recording = self._play(planned)
            if not recording.lost.size:
                break
            self._keep_partial(recording, planned, _losses(recording))
            if attempt == MAX_RETRIES:
                if not self.plan.by_itself:  # a computer that stalls loses samples, whatever its cable
                    _judge_timing(recording.timing, self.max_jitter_share)
                raise SampleLossError(
                    "recording",
                    f"{_losses(recording)}, in {attempt + 1} motions in a row",
                    "Check cabling, termination and bus load, or lower --rate.",
                )
            self.retries += 1
            self.observer.note(f"{_losses(recording)}: the motion is made again")
            self._go(self.plan.way_back(planned))
        return recording

    def _warn_of_way_back(self, timing: SyncTiming) -> None:
        """A drive that does all by itself is told by a frame when to move back: that start is as uneven as SYNC."""
        if self.plan.motion.returns and timing.p99_s > UNEVEN_START_S:
            self.observer.note(
                f"SYNC came up to {timing.max_s * 1e3:.2g} ms unevenly, and so starts the way back: "
                "--one-way is surer on this adapter"
            )

    def _progress(self, done: int, total: int) -> None:
        self.interrupt.let_through()
        self.observer.progress(done, total)

    def _play(self, planned: PlannedRun) -> Recording:
        """Play one run; where it breaks off, keep what came until then as a partial recording."""
        self.interrupt.let_through()
        try:
            return self.drive.play(setpoints_of(planned, self.plan), self._progress)
        except BaseException as error:
            partial = partial_recording(error)
            if partial is not None:
                self._keep_partial(partial, planned, str(error) or type(error).__name__)
            raise

    def _go(self, way: PlannedRun | None) -> None:
        """Move without recording, for the axis to be where the next motion starts."""
        if way is not None:
            setpoints = replace(setpoints_of(way, self.plan), recorded=False)
            self.interrupt.let_through()
            self.drive.play(setpoints, lambda done, total: self.interrupt.let_through())

    def _keep_partial(self, recording: Recording, planned: PlannedRun, why: str) -> None:
        """What came before the first gap, where that is anything at all."""
        before = _gapless(recording)
        if before.position_rad.size > MIN_PARTIAL_SAMPLES:
            self.writer.append_partial(run_of(before, planned, self.plan, self.source), why)


def _losses(recording: Recording) -> str:
    lost, total = recording.lost.size, recording.position_rad.size
    first = f"the first at {'SYNC' if recording.sampling == 'sync' else 'row'} {int(recording.lost[0])}"
    return f"{lost} of {total} samples were lost ({lost / total:.2%}), {first}"


def _gapless(recording: Recording) -> Recording:
    """The part before the first lost sample: gaps are never bridged."""
    end = int(recording.lost[0]) if recording.lost.size else recording.position_rad.size
    names = (
        "sync_count", "receive_time_s", "statusword", "position_rad", "speed_rad_s", "torque_nm",
        "position_demand_rad", "torque_added_nm",
    )  # fmt: skip
    arrays = {name: getattr(recording, name)[:end] for name in names}
    return replace(recording, lost=recording.lost[:0], **arrays)


def _judge_timing(timing: SyncTiming, max_share: float) -> None:
    """Raise DriveError where SYNC came unevenly. A drive clocked by SYNC (lockstep) has no jitter by construction."""
    if comes_unevenly(timing, max_share):
        raise DriveError(
            "SYNC",
            f"came unevenly: 99 % within {timing.p99_s * 1e3:.2f} ms, worst {timing.max_s * 1e3:.2f} ms "
            f"of a {timing.period_s * 1e3:g} ms period; samples and setpoints are off by as much",
            "Use an adapter with SocketCAN (the kernel makes SYNC), lower --rate, or accept it with --max-jitter.",
        )
