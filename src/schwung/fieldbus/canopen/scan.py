"""Who is on the bus: heartbeats heard, nodes asked, profiles that fit. Reads only."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable

import can

from schwung.errors import InputError, SdoError
from schwung.fieldbus import cia402, eds
from schwung.fieldbus.canopen import capabilities
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.nmt import NodeMonitor
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.drive import Capability, DriveIdentity, Parameter, Progress
from schwung.fieldbus.found import FoundNode
from schwung.fieldbus.profile import CanopenProfile, list_profiles

_ASK_S = 0.3  # for the answers to a request of 1000 to every node
_LISTEN_S = 0.3  # for heartbeats
_UPLOAD_DEVICE_TYPE = bytes([0x40, 0x00, 0x10, 0x00, 0, 0, 0, 0])
GENERIC = "generic-cia402"


def scan_bus(
    bus: can.BusABC, nodes: Iterable[int] = range(1, 128), progress: Progress | None = None
) -> tuple[FoundNode, ...]:
    """Find nodes, by SDO requests of object 1000 and by their heartbeats. Raises BusError.

    Nothing is written.
    """
    wanted = list(nodes)
    link = Link(bus)
    heard: dict[int, None] = {}
    try:
        monitors = {node: NodeMonitor(link, node) for node in wanted}

        def on_frame(message: can.Message) -> None:
            if message.arbitration_id & 0x780 in (0x580, 0x700):
                heard[message.arbitration_id & 0x7F] = None

        link.watch(on_frame)
        for node in wanted:
            link.send(0x600 + node, _UPLOAD_DEVICE_TYPE)
        link.clock.sleep(max(_ASK_S, _LISTEN_S))
        present = [node for node in wanted if node in heard]
        found = []
        for number, node in enumerate(present):
            if progress is not None:
                progress(number, len(present))
            examined = _examine(link, node, monitors[node])
            if examined is not None:
                found.append(examined)
        if progress is not None:
            progress(len(present), len(present))
        return tuple(found)
    finally:
        link.close()


def match_profile(bus: can.BusABC, node_id: int) -> CanopenProfile:
    """The profile that fits a node's identity best. Raises InputError when nobody answers or nothing fits."""
    link = Link(bus)
    try:
        identity = read_identity(SdoChannel(link, node_id), link.name)
    finally:
        link.close()
    fitting = fitting_profiles(identity)
    if not fitting:
        raise InputError(
            f"node {node_id}",
            f"no profile is for vendor 0x{identity.vendor_id:08X}, product 0x{identity.product_code:08X}",
            f"Write one, or try --profile {GENERIC}.",
        )
    return fitting[0]


def fitting_profiles(identity: DriveIdentity) -> list[CanopenProfile]:
    """Profiles for that vendor and product; one without an identity section must be asked for by name."""
    fitting = []
    for profile in list_profiles():
        if not isinstance(profile, CanopenProfile):
            continue
        want = profile.identity
        if want is None or want.vendor_id != identity.vendor_id:
            continue
        if want.product_code in (None, identity.product_code) and want.revision in (None, identity.revision):
            fitting.append(profile)
    return sorted(fitting, key=lambda p: (p.identity is None or p.identity.product_code is None, p.family))


def read_identity(sdo: SdoChannel, bus_name: str) -> DriveIdentity:
    """Objects 1018 and 1008. Raises InputError when the node does not answer."""
    try:
        vendor, product, revision, serial = (
            sdo.read_integer(0x1018, n, "UNSIGNED32") or 0 for n in (1, 2, 3, 4)
        )
    except SdoError as error:
        raise InputError(
            f"node {sdo.node_id}",
            f"does not answer on {bus_name}",
            "Look with `schwung scan`; check power, cable and bit rate.",
        ) from error
    name = ""
    with contextlib.suppress(SdoError):
        name = str(sdo.read(Parameter(0x1008, 0, "VISIBLE_STRING")).raw)
    return DriveIdentity(sdo.node_id, vendor, product, revision, serial, name)


def _examine(link: Link, node: int, monitor: NodeMonitor) -> FoundNode | None:
    sdo = SdoChannel(link, node, timeout_s=0.2, attempts=2)
    try:
        identity = read_identity(sdo, link.name)
        device_type = sdo.read_integer(0x1000, 0, "UNSIGNED32")
        status = sdo.read_integer(0x6041, 0, "UNSIGNED16")
        fitting = fitting_profiles(identity)
        offered: tuple[Capability, ...] = ()
        if fitting:
            lookup = eds.read_eds(fitting[0].eds_path, node).find

            def read(index: int, subindex: int) -> int | None:
                parameter = lookup(index, subindex)
                return None if parameter is None else sdo.read_integer(index, subindex, parameter.type)

            offered = capabilities.assess(fitting[0], lookup, read)
    except (InputError, SdoError):
        return None  # it sends heartbeats, but does not talk
    finally:
        sdo.close()
    return FoundNode(
        node_id=node,
        vendor_id=identity.vendor_id,
        product_code=identity.product_code,
        revision=identity.revision,
        serial=identity.serial,
        name=identity.name,
        device_type=device_type,
        nmt=monitor.nmt,
        cia402="" if status is None else cia402.decode(status).value,
        profiles=tuple(profile.family for profile in fitting),
        capabilities=offered,
    )
