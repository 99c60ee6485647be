"""One motion by the drive's own means: its generator injects, it makes the stroke, its trace records.

    generator on ─ wait until the sine is steady ─ start the stroke (the trace starts with it) ─ wait until the trace is
    full ─ generator off ─ read the trace

The bus takes no part in the timing: between start and the last sample the drive is only watched.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from schwung.clock import Clock
from schwung.errors import BusError, DriveError, InputError, NodeLostError, RegisterError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.drive import (
    Acquisition,
    Move,
    ParameterValue,
    Progress,
    Recording,
    Setpoints,
    Sine,
    SyncTiming,
    attach_recording,
)
from schwung.fieldbus.modbus.registers import Registers
from schwung.fieldbus.modbus.state_machine import POLL_S, StateMachine
from schwung.fieldbus.modbus.trace import TraceBuffer
from schwung.fieldbus.profile import Generator, ModbusProfile, ObjectRef, Strokes
from schwung.fieldbus.tracing import TraceRequest, recording_of, sine_torque, trace_request
from schwung.fieldbus.units import Scales, torque_scale

_ACKNOWLEDGED_S = 0.5
_LATE_S = 1.0  # a stroke or a trace that is not over so long after its time has failed
_OFF_START_RAD = 0.05


@dataclass(frozen=True)
class Means:
    """What the drive does by itself, with the registers for it."""

    registers: Registers
    state_machine: StateMachine
    profile: ModbusProfile
    strokes: Strokes
    target: ObjectRef
    trace: TraceBuffer | None

    @property
    def clock(self) -> Clock:
        """The link's."""
        return self.registers.link.clock

    def changed(self) -> list[ObjectRef]:
        """What `play` changes, and puts back."""
        g, s = self.profile.generator, self.strokes
        refs = [self.target, s.speed.object, s.acceleration.object, s.deceleration.object]
        if g is not None:
            refs += [g.amplitude.object, g.frequency.object, g.control.object]
            refs += [g.phase.object] if g.phase is not None else []
        if self.trace is not None:
            refs += self.trace.parameters()
        return refs

    def generator_off(self) -> None:
        """Generator off. Raises RegisterError."""
        generator = self.profile.generator
        if generator is not None:
            self.registers.put(generator.control.object, generator.control.off)

    # ── one motion ───────────────────────────────────────────────────────────────────────────────────────────────

    def play(
        self, setpoints: Setpoints, acquisition: Acquisition, scales: Scales, progress: Progress | None
    ) -> Recording:
        """Make the stroke and record it. Raises InputError before anything moves; on trouble the drive is halted."""
        move, request = self._checked(setpoints, acquisition, scales)
        settings = self._stroke_settings(move, scales)
        generator = self.profile.generator
        if setpoints.generator is not None:
            if generator is None:
                raise InputError(
                    f"profile {self.profile.family}",
                    self.profile.reason("generator"),
                    "Choose another drive.",
                )
            settings += self._sine_settings(generator, setpoints.generator)
        began_s = 0.0
        with self._temporarily(settings), self._kept():
            try:
                with self._injecting(generator, setpoints.generator):
                    if request is not None and self.trace is not None:
                        self._write(self.trace.settings(request))
                        self.trace.arm()
                    self._watch(move.at_index / setpoints.sample_rate_hz)
                    began_s = self._start(move, scales)
                    end_s = began_s + (setpoints.position_rad.size - move.at_index) / setpoints.sample_rate_hz
                    self._await(end_s, setpoints, request, progress, at_target=setpoints.generator is None)
                self._await(self.clock.now(), setpoints, None, None, at_target=True)
                return self._recording(setpoints, move, request, scales, progress)
            except BaseException as error:
                self.state_machine.halt()
                if request is not None and began_s and not isinstance(error, BusError | NodeLostError):
                    came = (self.clock.now() - began_s) * request.rate_hz
                    self._attach(error, setpoints, move, request, scales, came)
                raise

    def _checked(
        self, setpoints: Setpoints, acquisition: Acquisition, scales: Scales
    ) -> tuple[Move, TraceRequest | None]:
        """The one stroke and how it is traced. Raises InputError, StateError."""
        if len(setpoints.moves) != 1:
            raise InputError(
                "motion",
                f"has {len(setpoints.moves)} strokes; over Modbus each is started by a request, so one of several "
                "cannot be timed" if setpoints.moves else "has no stroke that the drive could make by itself",
                "Use --mode pp and --one-way.",
            )  # fmt: skip
        move, rate = setpoints.moves[0], setpoints.sample_rate_hz
        stands = self.registers.integer(self.profile.quantities.position.object) * scales.position_rad
        if abs(stands - setpoints.position_rad[0]) > _OFF_START_RAD:
            raise StateError(
                f"unit {self.registers.link.unit}",
                f"stands at {stands:.4g} rad, the motion starts at {setpoints.position_rad[0]:.4g} rad",
                "Start the motion where the axis stands.",
            )
        if acquisition.sampling != "trace" or self.profile.trace is None or not setpoints.recorded:
            return move, None
        duration = (setpoints.position_rad.size - 1 - move.at_index) / rate
        whole = trace_request(
            self.profile.trace, max(acquisition.trace_s, duration), acquisition.trace_rate_hz
        )
        return move, whole.over(duration)

    def _start(self, move: Move, scales: Scales) -> float:
        """Start the stroke; returns when that was asked for. The start command is sent once, whatever happens."""
        self.registers.put(self.target, round(move.target_rad / scales.position_rad))
        self.state_machine.check()
        began_s = self.clock.now()
        self.state_machine.advance(cia402.ENABLE_OPERATION | cia402.NEW_SET_POINT | cia402.CHANGE_AT_ONCE)
        while not self.state_machine.check() & cia402.SET_POINT_ACKNOWLEDGE:
            if self.clock.now() - began_s > _ACKNOWLEDGED_S:
                raise StateError(
                    f"unit {self.registers.link.unit}",
                    "did not take the stroke",
                    "Look at its limits and its mode.",
                )
            self.clock.sleep(POLL_S)
        self.state_machine.advance(cia402.ENABLE_OPERATION)
        return began_s

    def _await(
        self,
        end_s: float,
        setpoints: Setpoints,
        request: TraceRequest | None,
        progress: Progress | None,
        *,
        at_target: bool,
    ) -> None:
        """Watch the drive until `end_s`, and on until the trace is full and the stroke over.

        While the sine shakes it, the axis may never be at rest in its target: `at_target` is for afterwards.
        Raises what happens meanwhile, StateError for lateness.
        """
        count, rate = setpoints.position_rad.size, setpoints.sample_rate_hz
        while True:
            word, now = self.state_machine.check(), self.clock.now()
            if progress is not None:
                progress(max(0, min(count - int((end_s - now) * rate), count)), count)
            if now >= end_s:
                traced = request is None or self.trace is None or self.trace.state() == "full"
                if traced and (not at_target or word & cia402.TARGET_REACHED):
                    return
                if now > end_s + _LATE_S:
                    what = "the stroke has not reached its target" if traced else "the trace did not fill"
                    raise StateError(
                        f"unit {self.registers.link.unit}",
                        f"{what} in time",
                        "Look at trigger, limits and mode.",
                    )
            self.clock.sleep(POLL_S)

    def _watch(self, duration_s: float) -> None:
        """Let time pass, noticing trouble."""
        end_s = self.clock.now() + duration_s
        while self.clock.now() < end_s:
            self.state_machine.check()
            self.clock.sleep(POLL_S)

    # ── injection ────────────────────────────────────────────────────────────────────────────────────────────────

    @contextlib.contextmanager
    def _injecting(self, generator: Generator | None, sine: Sine | None) -> Iterator[None]:
        if generator is None or sine is None:
            yield
            return
        start = generator.control.at_motion if sine.from_motion else generator.control.on
        if start is None:
            raise InputError(
                f"profile {self.profile.family}",
                "its generator cannot start with the motion",
                "Use --phases 1.",
            )
        self.state_machine.start(generator.control.object, start)
        yield
        self.generator_off()

    def _sine_settings(self, generator: Generator, sine: Sine) -> list[ParameterValue]:
        scale = abs(torque_scale(generator.amplitude, self.profile, self.registers.lookup_integer))
        wanted = [
            (generator.amplitude.object, sine.amplitude_nm / scale),
            (generator.frequency.object, sine.frequency_hz / generator.frequency.scale),
        ]
        if not all(math.isfinite(counts) and counts >= 0.5 for _, counts in wanted):
            raise InputError(
                "injection", "amplitude or frequency is too small for the drive", "Inject more, or faster."
            )
        if generator.phase is not None:
            wanted.append((generator.phase.object, sine.phase_rad / generator.phase.scale))
        elif sine.from_motion and sine.phase_rad != 0:
            raise InputError("injection", "the drive's generator has no phase to set", "Use --phases 1.")
        return [ParameterValue(self.registers.at(ref), round(counts)) for ref, counts in wanted]

    def _stroke_settings(self, move: Move, scales: Scales) -> list[ParameterValue]:
        s = self.strokes
        wanted = [
            (s.speed, move.peak_speed_rad_s),
            (s.acceleration, move.acceleration_rad_s2),
            (s.deceleration, move.acceleration_rad_s2),
        ]
        return [
            ParameterValue(self.registers.at(x.object), max(round(value / x.scale), 1)) for x, value in wanted
        ]

    def _write(self, values: Sequence[ParameterValue]) -> None:
        for value in values:
            self.registers.write(value.parameter, value.raw)

    @contextlib.contextmanager
    def _temporarily(self, values: Sequence[ParameterValue]) -> Iterator[None]:
        """Values that hold within, and what was there afterwards."""
        changed: list[ParameterValue] = []
        try:
            for value in values:
                old = self.registers.read(value.parameter)
                if old.raw != value.raw:
                    changed.append(old)
                    self.registers.write(value.parameter, value.raw)
            yield
        finally:
            for old in changed:
                with contextlib.suppress(DriveError):
                    self.registers.write(old.parameter, old.raw)

    @contextlib.contextmanager
    def _kept(self) -> Iterator[None]:
        """Target and window are where they were, afterwards; a target alone starts nothing."""
        cursor = self.profile.trace.cursor if self.profile.trace is not None else None
        refs = [self.target, *([cursor] if cursor is not None else [])]
        before = []
        for ref in refs:
            try:
                before.append(self.registers.read(self.registers.at(ref)))
            except RegisterError as error:
                if error.code is None:
                    raise  # refused: it takes a value and shows none, so that there is none to put back
        try:
            yield
        finally:
            for old in before:
                with contextlib.suppress(DriveError):
                    self.registers.write(old.parameter, old.raw)

    # ── what was recorded ────────────────────────────────────────────────────────────────────────────────────────

    def _recording(
        self,
        setpoints: Setpoints,
        move: Move,
        request: TraceRequest | None,
        scales: Scales,
        progress: Progress | None,
        came: int | None = None,
    ) -> Recording:
        """The trace in SI; an empty recording where none was wanted. `came`: rows that are surely there."""
        start_s = move.at_index / setpoints.sample_rate_hz
        if request is None or self.trace is None:
            request, columns = TraceRequest(setpoints.sample_rate_hz, 1, 0), {}
        else:
            rows = request.rows if came is None else min(came, request.rows)
            columns = dict(self.trace.read(rows, scales, progress))
            self.trace.stop()
        sine, added = setpoints.generator, None
        time_s = np.arange(request.rows) / request.rate_hz
        if sine is None:
            added = np.zeros(request.rows)
        elif sine.from_motion:
            added = sine_torque(sine, time_s)
        timing = SyncTiming("drive", 1 / request.rate_hz, 0.0, 0.0, 0.0)
        return recording_of(columns, request, start_s, timing, added)

    def _attach(
        self,
        error: BaseException,
        setpoints: Setpoints,
        move: Move,
        request: TraceRequest,
        scales: Scales,
        came: float,
    ) -> None:
        """What the trace holds of a motion that broke off; where it cannot be read, nothing."""
        with contextlib.suppress(DriveError, InputError):
            if self.trace is not None and self.trace.state() in ("running", "full"):
                self.trace.stop()
                attach_recording(
                    error, self._recording(setpoints, move, request, scales, None, came=int(came))
                )
