"""What a scan finds, whatever the bus."""

from __future__ import annotations

from dataclasses import dataclass

from schwung.fieldbus.drive import Capability


@dataclass(frozen=True)
class FoundNode:
    """One node (CANopen) or unit (Modbus) that answered. `profiles`: families that fit, the best first; capabilities
    are by the best."""

    node_id: int
    vendor_id: int
    product_code: int
    revision: int
    serial: int
    name: str
    device_type: int | None  # 1000; low half 402: a drive
    nmt: str  # by heartbeat; "UNKNOWN" where none came
    cia402: str  # "" where the node is no drive
    profiles: tuple[str, ...]
    capabilities: tuple[Capability, ...]
