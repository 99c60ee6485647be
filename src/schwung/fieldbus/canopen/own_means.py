"""What the drive does by itself around one motion: its generator injects, its trace buffer records."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from schwung.errors import DriveError, InputError, StateError
from schwung.fieldbus.canopen.generator import SineGenerator
from schwung.fieldbus.canopen.playback import Playable
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.canopen.trace import Lookup, TraceBuffer
from schwung.fieldbus.drive import Acquisition, Parameter, ParameterValue, Recording, Setpoints
from schwung.fieldbus.profile import CanopenProfile, CapabilityName
from schwung.fieldbus.tracing import TraceRequest, motion_index, recording_of, sine_torque, trace_request
from schwung.fieldbus.units import Scales
from schwung.motion import Array

__all__ = ["Around", "Lookup", "OwnMeans"]

T = TypeVar("T")
Pump = Callable[[float], bool]  # lets so much of the drive's time pass; False when it does not answer

_FULL_WITHIN_S = 0.2  # of the drive's time, after the last setpoint
_STEP_S = 0.005


class OwnMeans:
    """The generator and the trace of one drive, as far as its profile has them."""

    def __init__(self, sdo: SdoChannel, profile: CanopenProfile, lookup: Lookup) -> None:
        self._sdo, self._profile, self._lookup = sdo, profile, lookup
        self._generator: SineGenerator | None = None

    def settings(self, acquisition: Acquisition) -> list[ParameterValue]:
        """What `setup` has to write for such an acquisition. Raises InputError where the profile lacks the means."""
        values = []
        if acquisition.sampling == "trace":
            values += self._trace().settings(self._request(acquisition))
        if acquisition.injecting == "generator":
            values.append(self._sine_generator().silent())
        return values

    def parameters(self, acquisition: Acquisition) -> list[Parameter]:
        """What playing changes, and puts back by itself."""
        if acquisition.injecting != "generator":
            return []
        return self._sine_generator().parameters()

    def around(
        self, setpoints: Setpoints, acquisition: Acquisition, playable: Playable, scales: Scales
    ) -> Around:
        """Everything for one motion, worked out before it begins. Raises InputError."""
        generator, settings = None, []
        if setpoints.generator is not None:
            generator = self._sine_generator()
            settings += generator.settings(setpoints.generator)
        trace = None
        if acquisition.sampling == "trace" and setpoints.recorded:
            rate, count = setpoints.sample_rate_hz, setpoints.position_rad.size
            begin = motion_index(playable.position_counts, setpoints)
            request = self._request(acquisition).over((count - 1 - begin) / rate)
            buffer = self._trace()
            settings += buffer.settings(request)
            trace = _Traced(
                buffer, request, begin, rate, self._held(playable, setpoints, begin, request, scales)
            )
        return Around(self._sdo, setpoints, scales, settings, generator, trace)

    def kill(self) -> None:
        """Generator off, at once, where it may be on. Never raises."""
        if self._generator is not None:
            self._generator.kill()

    def _request(self, acquisition: Acquisition) -> TraceRequest:
        trace = self._needed(self._profile.trace, "trace buffer", "Sample by SYNC.")
        return trace_request(trace, acquisition.trace_s, acquisition.trace_rate_hz)

    def _trace(self) -> TraceBuffer:
        trace = self._needed(self._profile.trace, "trace buffer", "Sample by SYNC.")
        return TraceBuffer(self._sdo, trace, self._lookup)

    def _sine_generator(self) -> SineGenerator:
        if self._generator is None:
            generator = self._needed(self._profile.generator, "generator", "Inject by setpoints.")
            self._generator = SineGenerator(self._sdo, self._profile, generator, self._lookup)
        return self._generator

    def _needed(self, part: T | None, capability: CapabilityName, remedy: str) -> T:
        if part is None:
            raise InputError(f"profile {self._profile.family}", self._profile.reason(capability), remedy)
        return part

    @staticmethod
    def _held(
        playable: Playable, setpoints: Setpoints, begin: int, request: TraceRequest, scales: Scales
    ) -> Array | None:
        """What was injected up to each row's instant; None where only the drive knows.

        A setpoint's torque is in force from its SYNC to the next; the motion starts with the SYNC of `begin` + 1, or
        with that of `begin` where a move is commanded.
        """
        time = np.arange(request.rows) / request.rate_hz
        sine = setpoints.generator
        if sine is not None:
            return sine_torque(sine, time) if sine.from_motion else None
        scale = scales.torque_added_nm if math.isfinite(scales.torque_added_nm) else 0.0
        first = begin if setpoints.moves else begin + 1
        held = first + np.ceil(time * setpoints.sample_rate_hz - 1e-6).astype(int) - 1
        counts = np.append(playable.torque_added_counts, 0)  # after the last one: none
        return np.asarray(counts[np.minimum(held, counts.size - 1)] * scale, dtype=float)


@dataclass(frozen=True, eq=False)
class _Traced:
    """A trace of one motion."""

    buffer: TraceBuffer
    request: TraceRequest
    begin: int  # the setpoint after which the motion starts
    setpoint_rate_hz: float
    torque_added_nm: Array | None

    @property
    def start_s(self) -> float:
        return self.begin / self.setpoint_rate_hz


@dataclass(frozen=True, eq=False)
class Around:
    """One motion's injection and trace: what to write before, what to do around it, what to read after it."""

    sdo: SdoChannel
    setpoints: Setpoints
    scales: Scales
    settings: list[ParameterValue]
    generator: SineGenerator | None
    trace: _Traced | None

    @contextmanager
    def acting(self, check: Callable[[], None]) -> Iterator[None]:
        """Generator on and trace armed within; the generator is off afterwards.

        `check` is called right before it is switched on, and raises what has come between.
        """
        if self.generator is None or self.setpoints.generator is None:
            self._arm()
            yield
            return
        with self.generator.running(self.setpoints.generator, check):
            self._arm()
            yield

    def _arm(self) -> None:
        if self.trace is not None:
            self.trace.buffer.arm()

    def recorded(
        self, by_sync: Recording, error: BaseException | None, pump: Pump
    ) -> tuple[Recording, BaseException | None]:
        """The trace where there is one, else what SYNC sampled; and what went wrong.

        After trouble the trace is read as far as it came, where the drive still answers.
        """
        trace = self.trace
        if trace is None:
            return by_sync, error
        try:
            ended = self._await_full(trace.buffer, pump) if error is None else trace.buffer.progress()
            if ended != "full":
                trace.buffer.stop()
            columns = trace.buffer.read(self.scales)
            trace.buffer.stop()
        except (DriveError, KeyboardInterrupt) as trouble:
            return by_sync, error or trouble
        recording = recording_of(
            columns, trace.request, trace.start_s, by_sync.timing, trace.torque_added_nm, by_sync.notes
        )
        if recording.lost.size == recording.position_rad.size:
            missed = StateError(
                f"node {self.sdo.node_id}", f'its trace did not start with the motion (it is "{ended}")',
                "Look at trigger and control of [trace] in the profile, or sample by SYNC.",
            )  # fmt: skip
            return by_sync, error or missed
        return recording, error

    @staticmethod
    def _await_full(buffer: TraceBuffer, pump: Pump) -> str:
        for _ in range(round(_FULL_WITHIN_S / _STEP_S)):
            if buffer.progress() == "full":
                return "full"
            pump(_STEP_S)
        return buffer.progress()
