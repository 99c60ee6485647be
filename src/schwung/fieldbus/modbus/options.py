"""Which Modbus connection, from the flags that python-can's buses take: -i modbus-tcp -c HOST:PORT, -i modbus-rtu
-c DEVICE -b RATE; further settings as --bus key=value (parity, stopbits, timeout)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from schwung.errors import InputError
from schwung.fieldbus.profile import Modbus

Parity = Literal["N", "E", "O"]
INTERFACES = ("modbus-tcp", "modbus-rtu")
#: What the standard demands as default (Modbus over Serial Line 1.02, 2.5.1.1 and 3.4), and its port on TCP.
USUAL_BAUDRATE, USUAL_STOPBITS, TCP_PORT = 19200, 1, 502
USUAL_PARITY: Parity = "E"
#: Above this rate the pause of 3.5 characters is fixed (Modbus over Serial Line 1.02, 2.5.1.1).
_FIXED_PAUSE_ABOVE, _FIXED_PAUSE_S = 19200, 1.75e-3
_CHARACTER_BITS = 11


@dataclass(frozen=True)
class ModbusOptions:
    """A connection, checked. What is None is as the drive's profile has it; see `completed`."""

    transport: Literal["tcp", "rtu"]
    host: str = ""
    port: int = TCP_PORT
    device: str = ""
    baudrate: int | None = None
    parity: Parity | None = None
    stopbits: int | None = None
    timeout_s: float | None = None

    @property
    def name(self) -> str:
        """For people: modbus-tcp 127.0.0.1:502."""
        return (
            f"modbus-tcp {self.host}:{self.port}" if self.transport == "tcp" else f"modbus-rtu {self.device}"
        )

    def completed(self, drive: Modbus) -> ModbusOptions:
        """With what was not given as the profile has it, else as the standard."""
        return replace(
            self,
            baudrate=self.baudrate or drive.baudrate or USUAL_BAUDRATE,
            parity=self.parity or drive.parity or USUAL_PARITY,
            stopbits=self.stopbits or drive.stopbits or USUAL_STOPBITS,
            timeout_s=self.timeout_s or drive.timeout_s,
        )


def modbus_options(
    interface: str, channel: str | None, bitrate: int | None, extra: Mapping[str, Any]
) -> ModbusOptions:
    """Check flags. Raises InputError naming the one that is wrong."""
    known = {"timeout", "parity", "stopbits"} if interface == "modbus-rtu" else {"timeout"}
    unknown = sorted(set(extra) - known)
    if unknown:
        raise InputError(
            f"--bus {unknown[0]}", f"is no option of {interface}", f"It takes {', '.join(sorted(known))}."
        )
    timeout_s = _timeout(extra)
    if interface == "modbus-tcp":
        host, port = _address(channel)
        return ModbusOptions("tcp", host=host, port=port, timeout_s=timeout_s)
    if interface != "modbus-rtu":
        raise InputError("--interface", f'"{interface}" is no Modbus', f"Use {' or '.join(INTERFACES)}.")
    if not channel:
        raise InputError("--channel", "is missing", "Give the serial device, e.g. -c /dev/ttyUSB0.")
    if bitrate is not None and bitrate <= 0:
        raise InputError("--bitrate", f"is {bitrate}", "Give a rate like 19200 or 115200.")
    stopbits = extra.get("stopbits")
    if stopbits not in (None, 1, 2):
        raise InputError("--bus stopbits", f"is {stopbits}", "Use 1 or 2.")
    return ModbusOptions(
        "rtu", device=channel, baudrate=bitrate, parity=_parity(extra), stopbits=stopbits, timeout_s=timeout_s
    )


def _parity(extra: Mapping[str, Any]) -> Parity | None:
    parities: dict[str, Parity] = {"N": "N", "E": "E", "O": "O"}
    given = extra.get("parity")
    if given is None:
        return None
    try:
        return parities[str(given).upper()]
    except KeyError:
        raise InputError("--bus parity", f'is "{given}"', "Use N, E or O.") from None


def silence_s(options: ModbusOptions) -> float:
    """The pause between frames that the standard demands: 3.5 characters, 1.75 ms above 19200 bit/s; none on TCP."""
    if options.transport == "tcp":
        return 0.0
    baudrate = options.baudrate or USUAL_BAUDRATE
    return _FIXED_PAUSE_S if baudrate > _FIXED_PAUSE_ABOVE else 3.5 * _CHARACTER_BITS / baudrate


def _timeout(extra: Mapping[str, Any]) -> float | None:
    value = extra.get("timeout")
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 60:
        raise InputError("--bus timeout", f"is {value}", "Give seconds, e.g. timeout=1.5.")
    return float(value)


def _address(channel: str | None) -> tuple[str, int]:
    if not channel:
        raise InputError("--channel", "is missing", "Give the drive's address, e.g. -c 192.168.0.10:502.")
    host, colon, port = channel.rpartition(":")
    if not colon:
        return channel, TCP_PORT
    if not (host and port.isdigit() and 0 < int(port) < 65536):
        raise InputError("--channel", f'"{channel}" is no address', "Write HOST or HOST:PORT.")
    return host.strip("[]"), int(port)
