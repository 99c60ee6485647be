"""Emergency messages and error codes (603F) in words. Source: CiA 301 table 26, CiA 402-2 error codes."""

from __future__ import annotations

from dataclasses import dataclass

_CODES = {
    0x0000: "error reset, or no error", 0x1000: "generic error",
    0x2000: "current", 0x2100: "current, device input side", 0x2130: "short circuit or earth leakage, input",
    0x2200: "internal current", 0x2300: "current, device output side", 0x2310: "continuous over-current",
    0x2320: "short circuit or earth leakage, output", 0x2330: "earth leakage, output", 0x2340: "short circuit, motor",
    0x3000: "voltage", 0x3100: "mains voltage", 0x3110: "mains over-voltage", 0x3120: "mains under-voltage",
    0x3130: "phase failure", 0x3200: "DC link voltage", 0x3210: "DC link over-voltage",
    0x3220: "DC link under-voltage", 0x3230: "load error",
    0x3300: "output voltage", 0x3331: "field circuit interrupted",
    0x4000: "temperature", 0x4100: "ambient temperature", 0x4200: "device temperature",
    0x4210: "excess temperature, device", 0x4300: "drive temperature", 0x4310: "excess temperature, drive",
    0x5000: "device hardware", 0x5100: "supply", 0x5110: "low voltage supply", 0x5112: "24 V supply",
    0x5200: "control hardware", 0x5300: "operating unit", 0x5400: "power section", 0x5441: "safe torque off",
    0x5500: "data storage", 0x5530: "non-volatile memory",
    0x6000: "device software", 0x6010: "software reset (watchdog)", 0x6100: "internal software",
    0x6200: "user software", 0x6300: "data record", 0x6310: "loss of parameters", 0x6320: "parameter error",
    0x7000: "additional modules", 0x7100: "power", 0x7110: "brake chopper", 0x7121: "motor blocked",
    0x7122: "motor error or commutation", 0x7180: "motor", 0x7200: "measurement circuit", 0x7300: "sensor",
    0x7303: "resolver 1 fault", 0x7305: "incremental encoder 1 fault", 0x7310: "speed", 0x7320: "position",
    0x7380: "position sensor", 0x7500: "communication",
    0x8000: "monitoring", 0x8100: "communication", 0x8110: "CAN overrun, objects lost", 0x8120: "CAN error passive",
    0x8130: "heartbeat or life guarding: the drive missed the master's heartbeat", 0x8140: "recovered from bus-off",
    0x8150: "CAN identifier collision", 0x8180: "communication", 0x8200: "protocol error",
    0x8210: "PDO not processed: wrong length", 0x8220: "PDO too long", 0x8240: "SYNC with unexpected length",
    0x8250: "RPDO time-out", 0x8300: "torque control", 0x8311: "excess torque", 0x8331: "torque fault",
    0x8400: "speed controller", 0x8480: "speed following error", 0x8500: "position controller",
    0x8600: "positioning controller", 0x8611: "following error", 0x8612: "reference limit",
    0x8700: "SYNC controller: SYNC came irregularly or not at all", 0x8800: "winding controller",
    0x9000: "external error", 0xF000: "additional functions", 0xF001: "deceleration", 0xF002: "sub-synchronous run",
    0xFF00: "device specific",
}  # fmt: skip


def describe_code(code: int) -> str:
    """An error code in words: the exact one, else the family that its leading digits name."""
    for mask in (0xFFFF, 0xFFF0, 0xFF00, 0xF000):
        words = _CODES.get(code & mask)
        if words and (code & mask or not code):
            return f"0x{code:04X} {words}"
    return f"0x{code:04X} unknown error"


@dataclass(frozen=True)
class Emergency:
    """One emergency message: error code, error register (1001), five vendor bytes, receive time (s)."""

    code: int
    register: int
    vendor: bytes
    time_s: float

    @classmethod
    def decode(cls, data: bytes, time_s: float) -> Emergency:
        """From the frame's data; a short frame counts its missing bytes as 0."""
        full = bytes(data).ljust(8, b"\0")
        return cls(int.from_bytes(full[:2], "little"), full[2], full[3:8], time_s)

    @property
    def is_reset(self) -> bool:
        """True for "error reset / no error"."""
        return self.code >> 8 == 0

    def __str__(self) -> str:
        vendor = f", vendor bytes {self.vendor.hex(' ')}" if any(self.vendor) else ""
        return f"{describe_code(self.code)} (error register 0x{self.register:02X}{vendor})"
