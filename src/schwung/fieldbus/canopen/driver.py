"""A CiA 402 drive on CANopen, as commissioning sees it: implements `schwung.fieldbus.drive.Drive`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from typing import Any

import can

from schwung.errors import DriveError, EnergisedError, InputError, NodeLostError, StateError
from schwung.fieldbus import cia402, eds
from schwung.fieldbus.canopen import capabilities, guard, pdo, setup
from schwung.fieldbus.canopen.bus import ASSUMED_BIT_RATE, BusOptions, bus_load
from schwung.fieldbus.canopen.emcy import describe_code
from schwung.fieldbus.canopen.foreign import ForeignMasters
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.nmt import NodeMonitor, OtherMasters
from schwung.fieldbus.canopen.operation import Operation
from schwung.fieldbus.canopen.parameters import Parameters
from schwung.fieldbus.canopen.scan import read_identity
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.canopen.traffic import Traffic
from schwung.fieldbus.drive import (
    Acquisition,
    BusLoad,
    Capability,
    DriveIdentity,
    DriveLimits,
    DriveState,
    LiveSamples,
    Parameter,
    ParameterValue,
    Progress,
    Recording,
    Resolution,
    Setpoints,
    SyncChoice,
    SyncTiming,
)
from schwung.fieldbus.profile import CanopenProfile
from schwung.fieldbus.units import Scales, read_scales


class CanopenDrive:
    """One drive on a bus that somebody else opened, and closes.

    The constructor only reads. It raises InputError when nobody answers at the node id, or when profile and 1018
    disagree. `sync` chooses the producer of SYNC: "auto" takes lockstep where the drive's time is SYNC, the kernel
    on SocketCAN, and a thread elsewhere.
    """

    def __init__(
        self,
        bus: can.BusABC,
        node_id: int,
        profile: CanopenProfile,
        *,
        bit_rate: int | None = None,
        bus_options: BusOptions | None = None,
        sync: SyncChoice = "auto",
        sdo_timeout_s: float = 0.5,
    ) -> None:
        if not 1 <= node_id <= 126:
            raise InputError("node", f"{node_id} is no node id", "Give 1 to 126; 127 is ours.")
        self.profile, self.node_id = profile, node_id
        self._bit_rate, self._bus_options = bit_rate, bus_options
        self._scales: Scales | None = None
        self._boot_ups = 0  # that were heard before its units were read
        self._eds = eds.read_eds(profile.eds_path, node_id)
        self._lookup = self._eds.find
        self._layouts = pdo.layouts(profile, self._lookup, node_id)
        self._link = Link(bus, bit_rate or ASSUMED_BIT_RATE)
        self.clock = self._link.clock
        try:
            self._monitor = NodeMonitor(self._link, node_id)
            self._masters = OtherMasters(self._link)
            self._sdo = SdoChannel(self._link, node_id, sdo_timeout_s)
            self._identity = self._check_identity()
            self._operation = Operation(
                self._link, self._sdo, self._monitor, profile, self._layouts, sync, self._lookup, lambda: self.scales,
                counter=setup.has_counter(profile, self._lookup),
            )  # fmt: skip
            self._parameters = Parameters(
                self._link, self._sdo, self._monitor, self._masters, self._operation, profile, self._eds, self._layouts,
                lambda: self.scales,
            )  # fmt: skip
            self._integer = self._parameters.integer
            self._foreign = ForeignMasters(self._link, node_id, lambda: self._operation.running)
        except BaseException:
            self._link.close()
            raise

    # ── looking ──────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def identity(self) -> DriveIdentity:
        """Who answered when we connected."""
        return self._identity

    def state(self) -> DriveState:
        """NMT state by heartbeat ("UNKNOWN" where it sends none), CiA 402 state and error by SDO."""
        status = self._integer(0x6041, 0)
        code = self._integer(0x603F, 0) or 0
        voltage = None  # elsewhere bit 4 says nothing beside the state
        if (
            status is not None
            and cia402.decode(status) in cia402.WAITING
            and self.profile.voltage_bit == "supply"
        ):
            voltage = bool(status & cia402.VOLTAGE_ENABLED)
        return DriveState(
            nmt=self._monitor.nmt,
            cia402="unknown" if status is None else cia402.decode(status).value,
            position_rad=self._position_rad(),
            error=describe_code(code) if code else "",
            others=self._foreign.words,
            voltage=voltage,
            remote=None if status is None else bool(status & cia402.REMOTE),
            inputs=self._integer(0x60FD, 0),
        )

    def limits(self) -> DriveLimits:
        """607D, 6080 (rpm), 6072, 6076, 6065 and 6066; a disabled limit is None. And what changes their meaning."""
        scales = self.scales
        meaning = guard.meaning(
            scales, self._lookup, self._parameters.read_integer, self._parameters.quick_stop_option
        )
        offset = round(meaning["home_offset_rad"] / scales.position_rad)
        ends = guard.window_rad(self._integer(0x607D, 1), self._integer(0x607D, 2), scales, offset)
        peak = self._integer(0x6072, 0)
        window, patience = guard.limit(self._integer(0x6065, 0)), self._integer(0x6066, 0)
        rated = scales.rated_torque_nm
        return DriveLimits(
            position_min_rad=ends[0] if ends else None,
            position_max_rad=ends[1] if ends else None,
            speed_max_rad_s=guard.speed_limit_rad_s(self._integer(0x6080, 0)),
            torque_max_nm=peak * rated / 1000 if peak and peak != 0xFFFF and rated else None,
            rated_torque_nm=rated,
            following_error_rad=None if window is None else abs(window * scales.position_rad),
            following_error_time_s=None if patience is None else patience / 1000,
            **meaning,
        )

    @property
    def scales(self) -> Scales:
        """SI per count, read from the drive once. Raises InputError where neither drive nor profile tells a unit."""
        if self._scales is None:
            self._boot_ups = self._monitor.boot_ups
            self._scales = read_scales(self.profile, self._integer)
        return self._scales

    def resolution(self) -> Resolution:
        """SI value of one count."""
        return self.scales.resolution

    def capabilities(self) -> tuple[Capability, ...]:
        """What commissioning can do with this drive, by name, with reasons; see capabilities.assess."""
        return capabilities.assess(self.profile, self._lookup, self._integer)

    def bus_load(self, acquisition: Acquisition) -> BusLoad:
        """Share of the bus time of SYNC, PDOs and both heartbeats, worst-case stuffed."""
        rate, beats = acquisition.sample_rate_hz, 2 / acquisition.heartbeat_s
        sync = 1 if setup.has_counter(self.profile, self._lookup) else 0
        sizes = [sync, self._layouts.rpdo.size, *(t.size for t in self._layouts.tpdos)]
        bits = self._bit_rate or ASSUMED_BIT_RATE
        basis = f"{bits / 1000:g} kbit/s{'' if self._bit_rate else ' assumed'}, worst-case stuffing"
        return BusLoad(bus_load([*((size, rate) for size in sizes), (1, beats)], bits), basis)

    def measure_sync(self, sample_rate_hz: float) -> SyncTiming | None:
        """How evenly a thread of ours gets frames onto this bus; None where none would send SYNC. Raises BusError."""
        return self._operation.measure_sync(sample_rate_hz)

    def describe(self) -> dict[str, Any]:
        """JSON-ready: identity, profile, units and bus, as stored with a session."""
        resolution = self.resolution()
        return {
            "protocol": "CANopen CiA 402",
            "identity": vars(self._identity).copy(),
            "profile": self.profile.family,
            "profile_name": self.profile.name,
            "profile_verified": self.profile.verified,
            "units": {name: None if math.isnan(x) else x for name, x in vars(resolution).items()},
            "bus": {
                "name": self._link.name,
                "bit_rate": self._bit_rate or ASSUMED_BIT_RATE,
                "bit_rate_known": self._bit_rate is not None,
                **(self._bus_options.named() if self._bus_options is not None else {}),
            },
            "sync": self._operation.producer_name,
        }

    # ── parameters ───────────────────────────────────────────────────────────────────────────────────────────────

    def parameter(self, index: int, subindex: int = 0) -> Parameter:
        """Look up a parameter. Raises InputError, with the line in the EDS where that is known, when it lacks it."""
        return self._eds.parameter(index, subindex)

    def read(self, parameter: Parameter) -> ParameterValue:
        """See Parameters.read."""
        return self._parameters.read(parameter)

    def write(self, values: Sequence[ParameterValue]) -> None:
        """See Parameters.write."""
        self._parameters.write(values)

    def setup(self, acquisition: Acquisition) -> list[ParameterValue]:
        """See Parameters.setup."""
        return self._parameters.setup(acquisition)

    def passed_through(self, values: Sequence[ParameterValue]) -> list[Parameter]:
        """See Parameters.passed_through."""
        return self._parameters.passed_through(values)

    def store(self) -> None:
        """See Parameters.store."""
        self._parameters.store()

    # ── moving ───────────────────────────────────────────────────────────────────────────────────────────────────

    def start(self, acquisition: Acquisition) -> None:
        """Heartbeats on, node operational, PDO exchange running with the power stage off.

        Raises StateError when the drive is not set up for the acquisition, or does not answer SYNC, NodeLostError where
        it has restarted since its units were read, which are read anew then, or restarts meanwhile: it may not watch us
        any more. EnergisedError where somebody else has switched it on: it no longer watches us then, so that our
        leaving does not stop it.
        """
        scales = self.scales
        self._require_no_restart("since its units were read")
        missing = self.setup(acquisition)
        if missing:
            names = ", ".join(v.parameter.label for v in missing[:3])
            raise StateError(
                f"node {self.node_id}",
                f"is not set up: {names}{' …' if len(missing) > 3 else ''}",
                "Write `setup` first.",
            )
        self._parameters.beat(acquisition.heartbeat_s)
        try:
            self._operation.start(acquisition, scales, self.limits())
        except EnergisedError:
            with contextlib.suppress(DriveError):
                self._parameters.watch_us_no_more()
            raise
        try:
            self._require_no_restart("while it was started")
        except NodeLostError:
            self._operation.stop()
            raise

    def _require_no_restart(self, when: str) -> None:
        """Raises NodeLostError where a boot-up was heard since its units were read."""
        if self._monitor.boot_ups != self._boot_ups:
            self._scales = None
            raise NodeLostError(
                f"node {self.node_id}",
                f"restarted {when}: what it was set up for may be lost",
                "Check its supply, and begin anew.",
            )

    def enable(self) -> None:
        """Operation enabled, holding the position. Raises StateError naming what is missing, DriveFaultError."""
        self._masters.require_none()  # also one that was heard before anybody asked for trouble
        self._operation.enable()

    def play(self, setpoints: Setpoints, progress: Progress | None = None) -> Recording:
        """Play setpoints and record, one row per SYNC; see Drive.play.

        Raises StateError when the first position is not where the drive stands, InputError for setpoints that it
        cannot be given; on any trouble the drive is stopped and the error has the partial `recording`.
        """
        return self._operation.play(setpoints, progress)

    @property
    def traffic(self) -> Traffic:
        """See Counted."""
        return self._link.traffic

    def live(self) -> LiveSamples | None:
        """See Watched.live."""
        return self._operation.live.take()

    def halt(self) -> None:
        """Quick stop by RPDO and by SDO, torque offset 0. Never raises; from any thread."""
        self._operation.halt()

    def reset_fault(self) -> None:
        """Acknowledge a fault. Ends in Switch on disabled: nothing is energised. Raises StateError where it stays."""
        self._operation.reset_fault()

    def disable(self) -> None:
        """Power stage off, after standstill. A fault is left as it is (its power stage is off)."""
        self._operation.disable()

    def stop(self) -> None:
        """End SYNC and PDOs; node pre-operational. Our heartbeat goes on while the drive listens for it."""
        self._operation.stop()

    def close(self) -> None:
        """End all of ours; the bus stays open. Never hangs. A drive that still runs is stopped and switched off."""
        self._operation.close()
        self._parameters.close()
        self._monitor.close()
        self._masters.close()
        self._foreign.close()
        self._sdo.close()
        self._link.close()

    def __enter__(self) -> CanopenDrive:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ── within ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _position_rad(self) -> float:
        ref = self.profile.quantities.position.object
        counts = self._integer(ref.index, ref.subindex)
        return math.nan if counts is None else counts * self.scales.position_rad

    def _check_identity(self) -> DriveIdentity:
        place = f"node {self.node_id}"
        identity = read_identity(self._sdo, self._link.name)
        expected = self.profile.identity
        for what, want, have in (
            ("vendor id", expected and expected.vendor_id, identity.vendor_id),
            ("product code", expected and expected.product_code, identity.product_code),
            ("revision", expected and expected.revision, identity.revision),
            ("vendor id (EDS)", self._eds.device_number("VendorNumber"), identity.vendor_id),
            ("product code (EDS)", self._eds.device_number("ProductNumber"), identity.product_code),
        ):
            if expected is not None and want is not None and want != have:
                raise InputError(
                    f"{place}, 1018", f"{what} is 0x{have:08X}, profile {self.profile.family} is for 0x{want:08X}",
                    "Choose the profile of this drive; `schwung scan` tells which fit.",
                )  # fmt: skip
        return identity
