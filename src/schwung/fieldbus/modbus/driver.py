"""A drive on Modbus, as commissioning sees it: implements `schwung.fieldbus.drive.Drive`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from typing import Any

from schwung.clock import Clock, Task
from schwung.errors import DriveError, InputError, RefusedError, RegisterError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.drive import (
    Acquisition,
    BusLoad,
    Capability,
    DriveIdentity,
    DriveLimits,
    DriveState,
    Parameter,
    ParameterValue,
    Progress,
    Recording,
    Resolution,
    Setpoints,
)
from schwung.fieldbus.modbus import capabilities, setup
from schwung.fieldbus.modbus.link import ACKNOWLEDGE, ModbusLink
from schwung.fieldbus.modbus.play import Means
from schwung.fieldbus.modbus.registers import Registers
from schwung.fieldbus.modbus.state_machine import StateMachine
from schwung.fieldbus.modbus.trace import TraceBuffer
from schwung.fieldbus.profile import ModbusProfile
from schwung.fieldbus.units import Scales, read_scales

_STORE_TIMEOUT_S = 10.0


class ModbusDrive:
    """One drive at the end of a link that it owns: closing the drive closes the link.

    The constructor only reads. It raises InputError when nobody answers, or when profile and drive disagree.
    """

    def __init__(
        self, link: ModbusLink, profile: ModbusProfile, *, bus: dict[str, Any] | None = None
    ) -> None:
        self.profile, self._link = profile, link
        self.clock: Clock = link.clock
        self._bus = bus or {}
        self._registers = Registers(link, profile)
        self._scales: Scales | None = None
        self._acquisition: Acquisition | None = None
        self._played: list[Parameter] = []
        self._keeper: Task | None = None
        self._trace = TraceBuffer(self._registers, profile.trace) if profile.trace is not None else None
        self._state_machine: StateMachine | None = None
        self._means: Means | None = None
        if profile.state is not None:
            self._state_machine = StateMachine(
                self._registers, profile.state, self._generator_off, self._position_counts, self._count_rad
            )
            demand = profile.quantities.position.demand
            if profile.strokes is not None and demand is not None:
                self._means = Means(
                    self._registers, self._state_machine, profile, profile.strokes, demand, self._trace
                )
        self._identity = self._check_identity()

    # ── looking ──────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def identity(self) -> DriveIdentity:
        """Who answered when we connected; 0 where the profile knows no register for it."""
        return self._identity

    def state(self) -> DriveState:
        """State of the state machine and error, read now; "unknown" where the profile has no state machine."""
        if self._state_machine is None:
            return DriveState(nmt="UNKNOWN", cia402="unknown", position_rad=self._position_rad())
        word = self._state_machine.statusword()
        return DriveState(
            nmt="UNKNOWN",
            cia402=cia402.decode(word).value,
            position_rad=self._position_rad(),
            error=self._state_machine.error_text(),
        )

    def limits(self) -> DriveLimits:
        """What the drive enforces; None for what the profile does not name, or the drive does not show."""
        limits, read, scale = self.profile.limits, self._registers.lookup_integer, self.scales.position_rad
        low = read(limits.position_min.index) if limits.position_min else None
        high = read(limits.position_max.index) if limits.position_max else None
        window = (
            sorted(x * scale for x in (low, high))
            if low is not None and high is not None and low < high
            else None
        )
        following = read(limits.following_error.index) if limits.following_error else None
        si = self._registers.si
        return DriveLimits(
            position_min_rad=window[0] if window else None,
            position_max_rad=window[1] if window else None,
            speed_max_rad_s=si(limits.speed_max) or None,
            torque_max_nm=si(limits.torque_max) or None,
            rated_torque_nm=si(limits.rated_torque) or None,
            following_error_rad=abs(following * scale) if following else None,
            following_error_time_s=si(limits.following_error_time),
            lacking=tuple(
                name
                for name, part in (
                    ("position limits", limits.position_max),
                    ("following error", limits.following_error),
                    ("following error time", limits.following_error_time),
                    ("torque limit", limits.torque_max),
                    ("speed limit", limits.speed_max),
                )
                if part is None
            ),
        )

    @property
    def scales(self) -> Scales:
        """SI per count. Raises InputError where neither drive nor profile tells a unit."""
        if self._scales is None:
            self._scales = read_scales(self.profile, self._registers.lookup_integer)
        return self._scales

    def resolution(self) -> Resolution:
        """SI value of one count."""
        return self.scales.resolution

    def capabilities(self) -> tuple[Capability, ...]:
        """What commissioning can do with this drive, by name, with reasons; see capabilities.assess."""
        return capabilities.assess(self.profile, self._registers)

    def bus_load(self, acquisition: Acquisition) -> BusLoad:
        """Nothing is exchanged cyclically."""
        return BusLoad(0.0, "Modbus: the drive moves and records by itself")

    def measure_sync(self, sample_rate_hz: float) -> None:
        """There is no SYNC."""

    def describe(self) -> dict[str, Any]:
        """JSON-ready: identity, profile, units and bus, as stored with a session."""
        return {
            "protocol": "Modbus",
            "identity": vars(self._identity).copy(),
            "profile": self.profile.family,
            "profile_name": self.profile.name,
            "profile_verified": self.profile.verified,
            "units": {name: None if math.isnan(x) else x for name, x in vars(self.resolution()).items()},
            "bus": {"name": self._link.name, **self._bus},
        }

    # ── parameters ───────────────────────────────────────────────────────────────────────────────────────────────

    def parameter(self, index: int, subindex: int = 0) -> Parameter:
        """The parameter at a register; with a sub-index, the element (from 1) of the array that begins there.

        Raises InputError for a register that the profile does not name.
        """
        found = self._registers.find(index, subindex)
        if found is None:
            raise InputError(
                f"profile {self.profile.family}",
                f"names no register {index}",
                "Check the address, or add it there.",
            )
        return found

    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters that the profile names, by address."""
        return tuple(self._registers)

    def read(self, parameter: Parameter) -> ParameterValue:
        """Read one parameter. Raises RegisterError, NodeLostError."""
        return self._registers.read(parameter)

    def write(self, values: Sequence[ParameterValue]) -> None:
        """Write parameters one after another, each once. Raises RegisterError at the first that the drive refuses, also
        where it had accepted it at first."""
        for value in values:
            if not self._registers.write(value.parameter, value.raw):
                self._require_held(value)

    def setup(self, acquisition: Acquisition) -> list[ParameterValue]:
        """What must be written for it and differs from what the drive holds. Raises InputError, RegisterError."""
        wanted = setup.wanted_values(self.profile, self._registers, acquisition, self.scales, self._trace)
        if self._means is not None:
            self._played = [self._registers.at(ref) for ref in self._means.changed()]
        return wanted

    def passed_through(self, values: Sequence[ParameterValue]) -> list[Parameter]:
        """What playing changes after `setup`, beyond these; see Drive.passed_through."""
        given = {value.parameter.index for value in values}
        return [parameter for parameter in self._played if parameter.index not in given]

    def store(self) -> None:
        """Save all parameters in the drive. Raises RegisterError where it refuses, InputError where the profile does
        not know how."""
        if self.profile.store is None:
            raise InputError(
                f"profile {self.profile.family}", self.profile.reason("store"), "Use --no-store."
            )
        with self._link.patience(_STORE_TIMEOUT_S):
            self._registers.put(self.profile.store.object, self.profile.store.value)

    # ── moving ───────────────────────────────────────────────────────────────────────────────────────────────────

    def start(self, acquisition: Acquisition) -> None:
        """Ready to move; the power stage stays off. From now on the drive hears us at a steady pace.

        Raises StateError when the drive is not set up for the acquisition.
        """
        missing = self.setup(acquisition)
        if missing:
            names = ", ".join(v.parameter.label for v in missing[:3])
            raise StateError(
                f"unit {self._link.unit}", f"is not set up: {names}{' …' if len(missing) > 3 else ''}",
                "Write `setup` first.",
            )  # fmt: skip
        self._required_state_machine()
        self._acquisition = acquisition
        self._close_keeper()
        silent_s = setup.silent_s(acquisition)
        self._keeper = self.clock.every(silent_s, lambda: self._be_heard(silent_s), "modbus keeper")

    def _be_heard(self, silent_s: float) -> None:
        """Where nobody else has asked for so long: the drive's watchdog is quiet for as long as we live.

        Failures are left to who asks next, and waits for the answer.
        """
        link = self._link
        if not link.asking and self.clock.now() - link.asked_s >= silent_s:
            with contextlib.suppress(DriveError):
                self._required_state_machine().look()

    def enable(self) -> None:
        """Operation enabled, holding the position. Raises StateError naming what is missing, DriveFaultError."""
        mode = None if self._acquisition is None else self.profile.modes[self._acquisition.mode]
        self._required_state_machine().enable(mode)

    def play(self, setpoints: Setpoints, progress: Progress | None = None) -> Recording:
        """Let the drive make one stroke and record it; see Drive.play and play.py.

        Raises InputError for setpoints that it cannot be given; on any trouble the drive is halted.
        """
        if self._acquisition is None or self._means is None:
            raise StateError(f"unit {self._link.unit}", "is not started", "Call `start` first.")
        return self._means.play(setpoints, self._acquisition, self.scales, progress)

    def halt(self) -> None:
        """Quick stop and generator off, until the drive shows it; nothing is started any more until `disable`.

        Never raises; from any thread.
        """
        if self._state_machine is not None:
            self._state_machine.halt()

    def reset_fault(self) -> None:
        """Acknowledge a fault. Ends in Switch on disabled: nothing is energised. Raises StateError where it stays."""
        self._required_state_machine().reset_fault()

    def disable(self) -> None:
        """Power stage off, after standstill. Where the profile knows no state machine, nothing was on by our doing.

        Raises StateError where it may still be on.
        """
        if self._state_machine is not None:
            self._state_machine.disable()

    def stop(self) -> None:
        """Go silent: the drive's watchdog is not fed any more."""
        self._close_keeper()
        self._acquisition = None

    def close(self) -> None:
        """End the connection. A drive that we may have left moving is halted and switched off first."""
        self._close_keeper()
        if self._state_machine is not None and self._state_machine.may_move:
            self.halt()
            with contextlib.suppress(DriveError):
                self._state_machine.disable()
        self._link.close()

    def __enter__(self) -> ModbusDrive:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _require_held(self, value: ParameterValue) -> None:
        held: object = value.raw
        with contextlib.suppress(RegisterError):  # some cannot be read
            held = self._registers.read(value.parameter).raw
        close = isinstance(held, float) and isinstance(value.raw, int | float)
        if not (math.isclose(held, value.raw, rel_tol=1e-6) if close else held == value.raw):  # type: ignore[arg-type]
            raise RegisterError(
                value.parameter.label,
                "was accepted at first, and then not taken",
                "Look at its limits.",
                ACKNOWLEDGE,
            )

    # ── within ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _check_identity(self) -> DriveIdentity:
        """Whoever answers must be what the profile describes. Raises InputError otherwise."""
        told: list[int] = []
        unit = self._link.unit
        try:
            for entry in self.profile.identity:
                told.append(self._registers.integer(entry.object) & entry.mask)
            serial = self._registers.integer(self.profile.serial) if self.profile.serial is not None else 0
            if not self.profile.identity:
                self._registers.integer(self.profile.quantities.position.object)
        except DriveError as error:
            raise InputError(
                f"unit {unit} on {self._link.name}",
                f"does not answer as {self.profile.name} does ({error.place}: {error.problem})",
                "Look with `schwung scan`; check unit, wiring, bit rate and parity, or choose another --profile.",
            ) from error
        for entry, found in zip(self.profile.identity, told, strict=True):
            if found != entry.value:
                raise InputError(
                    f"unit {unit}",
                    f"is no {self.profile.name}: register {entry.object.index} reads {found:#x}, not {entry.value:#x}",
                    "Choose another --profile; a wrong word order looks like this, too.",
                )
        vendor, product = (*told, 0, 0)[:2]
        return DriveIdentity(unit, vendor, product, 0, serial, self.profile.name)

    def _required_state_machine(self) -> StateMachine:
        if self._state_machine is None:
            raise RefusedError(
                f"profile {self.profile.family}",
                self.profile.reason("profile position"),
                "Choose another drive.",
            )
        return self._state_machine

    def _generator_off(self) -> None:
        if self._means is not None:
            self._means.generator_off()

    def _position_counts(self) -> int:
        return self._registers.integer(self.profile.quantities.position.object)

    def _count_rad(self) -> float:
        try:
            return self.scales.position_rad
        except (InputError, DriveError):
            return math.nan

    def _position_rad(self) -> float:
        return self._position_counts() * self.scales.position_rad

    def _close_keeper(self) -> None:
        if self._keeper is not None:
            self._keeper.close()
            self._keeper = None
