"""The drive's own sine by SDO: its parameters, on, and off on every way out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from schwung.errors import InputError, StateError
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.drive import Parameter, ParameterValue, Sine
from schwung.fieldbus.profile import CanopenProfile, Generator, ObjectRef
from schwung.fieldbus.units import torque_scale

Lookup = Callable[[int, int], Parameter | None]
_PATIENCE_S = 0.2  # for switching off on the way out


class SineGenerator:
    """One drive's generator, as [generator] of its profile describes it. Raises InputError where the EDS lacks an
    object of it."""

    def __init__(
        self, sdo: SdoChannel, profile: CanopenProfile, generator: Generator, lookup: Lookup
    ) -> None:
        self._sdo, self._profile, self._generator, self._lookup = sdo, profile, generator, lookup
        self._place = f"node {sdo.node_id}, generator"
        self._control = self._parameter(generator.control.object)
        self._may_run = self._killed = False

    def silent(self) -> ParameterValue:
        """The setting that keeps it off."""
        return ParameterValue(self._control, self._generator.control.off)

    def parameters(self) -> list[Parameter]:
        """Everything that an injection changes."""
        g = self._generator
        refs = [g.amplitude.object, g.frequency.object, *([g.phase.object] if g.phase else [])]
        return [*(self._parameter(ref) for ref in refs), self._control]

    def settings(self, sine: Sine) -> list[ParameterValue]:
        """Amplitude, frequency and phase in counts. Raises InputError for a sine that it cannot make."""
        g = self._generator
        scale = abs(torque_scale(g.amplitude, self._profile, self._read))
        wanted = [
            (g.amplitude.object, sine.amplitude_nm / scale),
            (g.frequency.object, sine.frequency_hz / g.frequency.scale),
        ]
        if g.phase is not None:
            wanted.append((g.phase.object, sine.phase_rad / g.phase.scale))
        elif sine.phase_rad != 0 and sine.from_motion:
            raise InputError(self._place, "has no phase that could be set", "Use --phases 1.")
        if any(not counts >= 0.5 for _, counts in wanted[:2]):
            raise InputError(
                self._place, "amplitude or frequency is too small for it", "Inject more, or faster."
            )
        return [ParameterValue(self._parameter(ref), round(counts)) for ref, counts in wanted]

    @contextmanager
    def running(self, sine: Sine, check: Callable[[], None]) -> Iterator[None]:
        """On within, or armed for the motion; off afterwards. `check` raises what forbids to switch it on.

        Raises SdoError where it cannot be switched on, or, when nothing else was wrong before, off.
        """
        control = self._generator.control
        start = control.at_motion if sine.from_motion else control.on
        if start is None:
            raise StateError(self._place, "cannot start with the motion", "Use --phases 1.")
        self._may_run, self._killed = True, False
        try:
            check()
            self._sdo.write(ParameterValue(self._control, start))
            yield
        except BaseException:
            self.kill()
            raise
        if not self._killed:  # else there is trouble already, and this one would hide it
            self._sdo.write(self.silent())
            self._may_run = False

    def kill(self) -> bool:
        """Off, now, where it may be on: one attempt, soon over. False where nobody answers. Never raises."""
        self._killed = True
        if self._may_run:
            off = self._generator.control.off
            self._may_run = not self._sdo.write_once(self._control, off, _PATIENCE_S)
        return not self._may_run

    def _read(self, index: int, subindex: int) -> int | None:
        parameter = self._lookup(index, subindex)
        return None if parameter is None else self._sdo.read_integer(index, subindex, parameter.type)

    def _parameter(self, ref: ObjectRef) -> Parameter:
        found = self._lookup(ref.index, ref.subindex)
        if found is None:
            raise InputError(self._place, f"the EDS lacks {ref}", "Use the EDS of this drive family.")
        return found
