"""The parameters of one Modbus drive, as its profile names them: found, read, written, in counts and in SI."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from schwung.errors import InputError, ParameterError, RegisterError
from schwung.fieldbus.drive import Parameter, ParameterValue, RawValue
from schwung.fieldbus.modbus import words
from schwung.fieldbus.modbus.link import ModbusLink
from schwung.fieldbus.profile import ModbusProfile, ObjectRef, ScaledObject


class Registers:
    """Registers of one drive by its profile."""

    def __init__(self, link: ModbusLink, profile: ModbusProfile) -> None:
        self.link, self.profile = link, profile
        names = {ref.index: name for name, ref in profile.parameters.items()}
        self._known = {
            ref.index: Parameter(ref.index, 0, ref.type, names.get(ref.index, place), "register")
            for place, ref in profile.refs()
            if place != "trace.data"  # a window, no parameter
        }
        table = profile.export.table
        if table is not None:
            for number in range(table.points):
                element = self._element(table.values, number + 1)
                self._known[element.index] = element

    def __iter__(self) -> Iterator[Parameter]:
        return iter(sorted(self._known.values(), key=lambda parameter: parameter.index))

    def find(self, address: int, subindex: int = 0) -> Parameter | None:
        """The parameter at an address; with a sub-index, the element of an array that begins there (from 1)."""
        known = self._known.get(address)
        if known is None or subindex == 0:
            return known
        return self._element(ObjectRef(index=address, space="register", type=known.type), subindex)

    def at(self, ref: ObjectRef) -> Parameter:
        """The parameter of a reference of the profile. Raises InputError for one that is none of its."""
        found = self.find(ref.index, ref.subindex)
        if found is None:
            raise InputError(
                f"profile {self.profile.family}", f"names no register {ref.index}", "Correct the profile."
            )
        return found

    def _element(self, first: ObjectRef, number: int) -> Parameter:
        width = words.word_count(first.type, self.profile.modbus.registers_per_parameter)
        address = first.index + (number - 1) * width
        return Parameter(address, 0, first.type, f"[{number}]", "register")

    # ── values ───────────────────────────────────────────────────────────────────────────────────────────────────

    def read(self, parameter: Parameter, *, again: bool = True) -> ParameterValue:
        """Read one parameter; `again` as in ModbusLink.read. Raises RegisterError, NodeLostError."""
        modbus = self.profile.modbus
        count = words.word_count(parameter.type, modbus.registers_per_parameter)
        try:
            read = self.link.read(parameter.index, count, again=again)
        except RegisterError as error:
            raise RegisterError(parameter.label, error.problem, error.remedy, error.code) from error
        return ParameterValue(parameter, words.decode(read, parameter.type, modbus.word_order))

    def write(self, parameter: Parameter, raw: RawValue, permit: Callable[[], None] | None = None) -> bool:
        """Write one parameter, once; `permit` and what is returned as in ModbusLink.write.

        Raises RegisterError, NodeLostError; InputError for a value that does not fit.
        """
        modbus = self.profile.modbus
        encoded = words.encode(raw, parameter.type, modbus.word_order, modbus.registers_per_parameter)
        try:
            return self.link.write(parameter.index, encoded, permit)
        except RegisterError as error:
            raise RegisterError(parameter.label, error.problem, error.remedy, error.code) from error

    def integer(self, ref: ObjectRef, *, again: bool = True) -> int:
        """What a reference of the profile holds; as `read`. Raises RegisterError, NodeLostError."""
        raw = self.read(self.at(ref), again=again).raw
        return int(raw) if isinstance(raw, int | float) else 0

    def put(self, ref: ObjectRef, value: int, permit: Callable[[], None] | None = None) -> None:
        """Write a reference of the profile, once; as `write`."""
        self.write(self.at(ref), value, permit)

    def si(self, scaled: ScaledObject | None) -> float | None:
        """What a scaled reference holds, in SI; None where the profile has none, or the drive refuses it."""
        if scaled is None:
            return None
        try:
            return self.integer(scaled.object) * scaled.scale
        except ParameterError:
            return None

    def lookup_integer(self, address: int, subindex: int = 0) -> int | None:
        """An integer by address; None where the profile or the drive has none. For `units.read_scales`."""
        parameter = self.find(address, subindex)
        if parameter is None:
            return None
        try:
            raw = self.read(parameter).raw
        except ParameterError:
            return None
        return int(raw) if isinstance(raw, int | float) else None
