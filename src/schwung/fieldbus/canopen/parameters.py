"""Parameters of one drive: what it is set up with, and how it is written, read and stored.

Beside them our heartbeat: it runs from the write that makes the drive listen for it (1016) until that is written back.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence

from schwung.errors import InputError, NodeLostError, SdoError, StateError
from schwung.fieldbus import cia402, eds
from schwung.fieldbus.canopen import guard, pdo, playback, setup
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.nmt import BEATS_PER_LIMIT, HeartbeatProducer, NodeMonitor, OtherMasters
from schwung.fieldbus.canopen.operation import Operation
from schwung.fieldbus.canopen.pdo import Layouts
from schwung.fieldbus.canopen.sdo import SdoChannel, went_unheard
from schwung.fieldbus.drive import Acquisition, Parameter, ParameterValue
from schwung.fieldbus.profile import CanopenProfile
from schwung.fieldbus.units import Scales

_SAVE = 0x65766173  # "save", little-endian, for 1010
_STORE_TIMEOUT_S = 10.0


class Parameters:
    """See the module; the driver says what is asked for, and in which units."""

    def __init__(
        self,
        link: Link,
        sdo: SdoChannel,
        monitor: NodeMonitor,
        masters: OtherMasters,
        operation: Operation,
        profile: CanopenProfile,
        known: eds.EdsFile,
        layouts: Layouts,
        read_scales: Callable[[], Scales],
    ) -> None:
        self._link, self._sdo, self._monitor, self._masters = link, sdo, monitor, masters
        self._operation, self._profile, self._known, self._layouts = operation, profile, known, layouts
        self._read_scales = read_scales
        self._place = f"node {sdo.node_id}"
        self._heartbeat: HeartbeatProducer | None = None
        self._played: list[Parameter] = []  # what playing changes, and puts back by itself

    def close(self) -> None:
        """Our heartbeat ends."""
        if self._heartbeat is not None:
            self._heartbeat.close()
            self._heartbeat = None

    def read(self, parameter: Parameter) -> ParameterValue:
        """Read one parameter. Raises SdoError. A PDO mapping entry that the drive does not show counts as 0."""
        try:
            return self._sdo.read(parameter)
        except SdoError:
            mapping = pdo.is_pdo_object(parameter) and parameter.index & 0x200 and parameter.subindex > 0
            if mapping and parameter.subindex > (self.integer(parameter.index, 0) or 0):
                return ParameterValue(parameter, 0)
            raise

    def write(self, values: Sequence[ParameterValue]) -> None:
        """Write parameters in the order that the standard demands, in pre-operational where that is needed.

        Any subset will do, also what a backup holds. Raises SdoError at the first that the drive refuses, StateError
        where PDO objects shall change while the drive is energised or exchanging PDOs.
        """
        with contextlib.ExitStack() as stack:
            if setup.needs_pre_operational(values):
                self._require_quiet()
                stack.enter_context(self._operation.pre_operational())
            setup.write_ordered(values, self.lookup, self._read_needed, self._write_one)

    def setup(self, acquisition: Acquisition) -> list[ParameterValue]:
        """What must be written for it and differs from what the drive holds. Raises InputError, SdoError."""
        wanted = setup.wanted_values(
            self._profile, self._layouts, acquisition, self.lookup, self.read_integer
        )
        strokes = playback.dynamics(acquisition.moves, self._read_scales(), self.lookup)
        wanted += [value for value in strokes if self.read_integer(value.parameter) != value.raw]
        if acquisition.guard is not None:
            option = self.quick_stop_option
            held = self.integer(guard.QUICK_STOP_OPTION, 0) if option is None else option
            limits = guard.tightened(
                acquisition.guard, self._read_scales(), self.lookup, self.read_integer, held
            )
            shaped = {value.parameter.index for value in strokes}  # 6084 is the stroke's in PP
            wanted += self._taken(value for value in limits if value.parameter.index not in shaped)
        own = self._operation.own_means
        self._played = own.parameters(acquisition)
        return wanted + [v for v in own.settings(acquisition) if self.read(v.parameter).raw != v.raw]

    def passed_through(self, values: Sequence[ParameterValue]) -> list[Parameter]:
        """Parameters, beyond these, that writing them changes on the way, and after `setup` what playing changes; see
        Drive.passed_through."""
        given = [value.parameter for value in values]
        found = setup.passed_through(values, self.lookup)
        return found + [p for p in self._played if p not in given and p not in found]

    def store(self) -> None:
        """Save all parameters in the drive (1010:01). Raises SdoError where it refuses, NodeLostError where it restarts
        meanwhile or does not answer. It is asked once: one that has restarted would confirm other parameters, and that
        it has may go unheard."""
        boot_ups, save = self._monitor.boot_ups, Parameter(0x1010, 1, "UNSIGNED32", "Save all")
        answered = True
        try:
            self._sdo.write(ParameterValue(save, _SAVE), _STORE_TIMEOUT_S, unheard="never")
        except SdoError as error:
            answered = not went_unheard(error)
            if answered:
                raise
        restarted = self._monitor.boot_ups != boot_ups
        if restarted or not answered:
            raise NodeLostError(
                self._place,
                f"{'restarted' if restarted else 'did not answer'} while it stored its parameters (1010): "
                "nobody knows which it holds",
                "Check its supply, compare them with what they shall be, and store again.",
            )

    @property
    def quick_stop_option(self) -> int | None:
        """What the profile puts into 605A."""
        setting = self._profile.stop.quick_stop_option
        return (
            setting.value if setting is not None and setting.object.index == guard.QUICK_STOP_OPTION else None
        )

    def lookup(self, index: int, subindex: int) -> Parameter | None:
        """What the EDS says of an object; None where it lacks it."""
        return self._known.find(index, subindex)

    def read_integer(self, parameter: Parameter) -> int | None:
        """None where the drive refuses it. Raises SdoError where it does not answer."""
        return self._sdo.read_integer(parameter.index, parameter.subindex, parameter.type)

    def integer(self, index: int, subindex: int) -> int | None:
        """As `read_integer`; None also where the EDS lacks the object."""
        parameter = self.lookup(index, subindex)
        return None if parameter is None else self.read_integer(parameter)

    def beat(self, period_s: float) -> None:
        """Our heartbeat, this often from now on. Raises StateError where another master beats as we do."""
        if self._heartbeat is not None and math.isclose(self._heartbeat.period_s, period_s):
            return
        if self._heartbeat is not None:
            self._heartbeat.close()
        self._heartbeat = HeartbeatProducer(self._link, self._monitor, self._masters, period_s)

    def watch_us_no_more(self) -> None:
        """The drive shall not listen for our heartbeat, which ends. Raises DriveError."""
        slot = setup.consumer_slot(self.lookup, self.read_integer)
        watching = None if slot is None else self.lookup(0x1016, slot)
        if watching is not None and setup.listens_to_us(self.read_integer(watching) or 0):
            self._write_one(ParameterValue(watching, 0))

    # ── within ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _taken(self, values: Iterable[ParameterValue]) -> Iterator[ParameterValue]:
        """Limits as far as the drive takes them: left out is what it only shows, cut what it has no range for."""
        for value in values:
            variable = self._known.variable(value.parameter.index, value.parameter.subindex)
            if variable is None or not variable.writable or not isinstance(value.raw, int):
                continue
            raw = value.raw if variable.high is None else min(value.raw, variable.high)
            raw = raw if variable.low is None else max(raw, variable.low)
            if raw == value.raw or raw != self.read_integer(value.parameter):
                yield ParameterValue(value.parameter, raw)

    def _read_needed(self, parameter: Parameter) -> int:
        raw = self.read(parameter).raw
        if not isinstance(raw, int):
            raise InputError(parameter.label, "is no integer", "Use the EDS of this drive.")
        return raw

    def _write_one(self, value: ParameterValue) -> None:
        """Write, with our heartbeat running exactly while the drive listens for it."""
        heard = (
            value.parameter.index == 0x1016 and isinstance(value.raw, int) and value.parameter.subindex > 0
        )
        listens = heard and setup.listens_to_us(int(value.raw))
        if listens:
            self.beat(int(value.raw) % 0x10000 / 1000 / BEATS_PER_LIMIT)
        if value.parameter.index == 0x1017 and not value.raw:
            self._monitor.expect(None)
        self._sdo.write(value)
        if heard and not listens and self._heartbeat is not None:
            self._heartbeat.close()
            self._heartbeat = None

    def _require_quiet(self) -> None:
        place = self._place
        if self._operation.running:
            raise StateError(place, "exchanges PDOs, which cannot be changed meanwhile", "Stop it first.")
        status = self.integer(0x6041, 0)
        state = cia402.decode(status)
        if state in cia402.ENERGISED or state is cia402.State.UNKNOWN:
            raise StateError(place, f'is in "{state.value}"', "Disable it before changing PDOs.")
