"""The bus: opened as python-can opens it, with its failures turned into sentences; and what frames cost on it."""

from __future__ import annotations

import contextlib
import json
import shutil
import socket
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can
from can.util import cast_from_string, load_config

from schwung.errors import BusError, InputError
from schwung.fieldbus.canopen.logged import LoggedBus

_SO_RCVBUFFORCE = 33  # asm-generic/socket.h; not in the socket module
_RECEIVE_BYTES = 4 << 20

ASSUMED_BIT_RATE = 1_000_000  # where nobody says: the one at which 1 kHz exchange is usual


@dataclass(frozen=True)
class BusOptions:
    """Which bus, in python-can's own words; None is left to its configuration (environment, can.conf).

    https://python-can.readthedocs.io/en/stable/configuration.html
    """

    interface: str | None = None
    channel: str | None = None
    bitrate: int | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)  # further keys of the interface: host, port, fd, …
    log: Path | None = None  # where every frame is written to, while the bus is open

    def named(self) -> dict[str, Any]:
        """What names the bus, JSON-ready: that it was logged is none of it."""
        return {
            "interface": self.interface,
            "channel": self.channel,
            "bitrate": self.bitrate,
            "extra": dict(self.extra),
        }

    @classmethod
    def from_flags(
        cls,
        interface: str | None = None,
        channel: str | None = None,
        bitrate: int | None = None,
        extra: Sequence[str] = (),
    ) -> BusOptions:
        """Take command line flags; `extra` holds key=value texts. Raises InputError for one without "="."""
        pairs: dict[str, Any] = {}
        for text in extra:
            key, equals, value = text.partition("=")
            if not (equals and key.strip()):
                raise InputError(
                    f'bus option "{text}"', "is not of the form key=value", "Write e.g. host=localhost."
                )
            pairs[key.strip().lstrip("-").replace("-", "_")] = cast_from_string(value)
        return cls(interface, channel, bitrate, pairs)

    def resolve(self) -> dict[str, Any]:
        """The configuration as python-can completes it. Raises InputError with python-can's complaint."""
        given: dict[str, Any] = dict(self.extra)
        named = {"interface": self.interface, "channel": self.channel, "bitrate": self.bitrate}
        given.update({key: value for key, value in named.items() if value is not None})
        try:
            config: dict[str, Any] = dict(load_config(config=given))
        except (can.CanError, ValueError, TypeError) as error:
            missing = isinstance(error, can.CanInterfaceNotImplementedError) and self.interface is None
            problem = "no interface is given or configured" if missing else _sentence(error)
            raise InputError("bus", problem, _REMEDY) from error
        if config.get("interface") is None:
            raise InputError("bus", "no interface is given or configured", _REMEDY)
        return {key: value for key, value in config.items() if value is not None}


_REMEDY = (
    "Give --interface and --channel (e.g. socketcan can0), or set CAN_INTERFACE and CAN_CHANNEL or can.conf."
)
_SERVER_S = 2.0
_GREETING = b"< hi >"  # what a socketcand server says first
_INSTALL = "Install what python-can needs for it, e.g. pip install 'python-can[serial]'."


def _sentence(error: Exception) -> str:
    """A library's complaint without its full stop: ours follows."""
    return str(error).rstrip(".! ")


def open_bus(options: BusOptions) -> can.BusABC:
    """Open the bus, logged where that is wanted.

    Raises InputError for a wrong option and BusError for an adapter that is not there or down.
    """
    config = options.resolve()
    if config.pop("receive_own_messages", None):
        # Frames of ours that came back would look like another master's.
        raise InputError("bus option receive_own_messages", "must not be set", "Leave it out.")
    where = f"{config['interface']} {config.get('channel', '')}".strip()
    if config["interface"] == "socketcand":
        _require_server(config, where)
    try:
        bus = can.Bus(ignore_config=True, **config)
    except (can.CanInterfaceNotImplementedError, ValueError, TypeError) as error:
        remedy = _INSTALL if "not installed" in str(error) else _REMEDY
        raise InputError(f"bus {where}", _sentence(error), remedy) from error
    except (can.CanError, OSError, TimeoutError) as error:
        raise BusError(
            f"bus {where}",
            f"cannot be opened ({_sentence(error)})",
            "Is the adapter plugged in, its driver installed and the interface up?",
        ) from error
    _widen(bus)
    if options.log is None:
        return bus
    try:
        return LoggedBus(bus, options.log, str(config.get("channel") or ""))
    except BaseException:
        bus.shutdown()
        raise


def _require_server(config: Mapping[str, Any], where: str) -> None:
    """python-can asks a server that is not there again for ten seconds, and waits for ever for one that is silent."""
    host, port = str(config.get("host", "")), config.get("port", 0)
    if not host or not port:
        raise InputError(
            f"bus {where}", "host or port is missing", "Add --bus host=ADDRESS --bus port=NUMBER."
        )
    try:
        connection = socket.create_connection((host, int(port)), timeout=_SERVER_S)
    except (OSError, ValueError, TypeError) as error:
        raise BusError(
            f"bus {where}",
            f"nobody serves it at {host}:{port} ({error})",
            "Start the server; check host and port.",
        ) from error
    with connection, contextlib.suppress(OSError):
        if connection.recv(len(_GREETING)) == _GREETING:
            return
    raise BusError(
        f"bus {where}",
        f"what listens at {host}:{port} does not greet as socketcand does",
        "Check host and port; restart the server.",
    )


def _widen(bus: can.BusABC) -> None:
    """Room for a second of unread frames on SocketCAN: by default 278 fit, then the newest are lost in silence."""
    raw = getattr(bus, "socket", None)
    if isinstance(raw, socket.socket) and raw.family == getattr(socket, "AF_CAN", None):
        for option in (
            socket.SO_RCVBUF,
            _SO_RCVBUFFORCE,
        ):  # the second passes the system's limit, for root only
            with contextlib.suppress(OSError):
                raw.setsockopt(socket.SOL_SOCKET, option, _RECEIVE_BYTES)


def bit_rate(options: BusOptions) -> int | None:
    """Bits per second: as configured, else as the kernel tells it for a SocketCAN interface; None: unknown."""
    config = options.resolve()
    if isinstance(config.get("bitrate"), int):
        return int(config["bitrate"])
    ip = shutil.which("ip")
    if config["interface"] == "socketcan" and ip and config.get("channel"):
        with contextlib.suppress(OSError, subprocess.SubprocessError, ValueError, LookupError, TypeError):
            told = subprocess.run(
                [ip, "-details", "-json", "link", "show", str(config["channel"])],
                capture_output=True, timeout=2, check=True,
            )  # fmt: skip
            return int(json.loads(told.stdout)[0]["linkinfo"]["info_data"]["bittiming"]["bitrate"])
    return None


def frame_bits(data_bytes: int) -> int:
    """Bits of a data frame with 11-bit identifier, worst-case stuffed, interframe space included.

    Davis, Burns, Bril, Lukkien, "Controller Area Network schedulability analysis", Real-Time Systems 35 (2007):
    8 s + g + 13 + ⌊(g + 8 s − 1)/4⌋ with g = 34.
    """
    return 8 * data_bytes + 47 + (34 + 8 * data_bytes - 1) // 4


def bus_load(frames: Iterable[tuple[int, float]], bits_per_s: float) -> float:
    """Share of the bus time that frames take: pairs of data bytes and frames per second; may exceed 1."""
    return sum(frame_bits(size) * rate for size, rate in frames) / bits_per_s
