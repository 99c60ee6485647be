"""Logs of a CAN bus: candump in both its formats, ASC, BLF, TRC through python-can, MDF4; also gzipped."""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.interchange import mdf

EXTENDED = 1 << 31  # set in `can_id` of a frame with a 29-bit identifier
_GZIP = b"\x1f\x8b"
_HEAD_BYTES = 4096
#: Seconds since 1970, or since the start (`-t z`), or since the frame before (`-t d`); a date with a time (`-t A`).
_STAMP = r"\((\d+\.\d+|\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+)\)"
#: `candump -L`: (1436509052.249713) can0 123#DEADBEEF, a direction behind it or not.
_LOGGED = re.compile(_STAMP + r"\s+(\S+)\s+([0-9A-Fa-f]{3,8})#([0-9A-Fa-f]*|[Rr]\d?|#\S+)(?:\s+([RrTt]))?$")
#: `candump -t a`, `-t z`: (1436509052.249713)  can0  123   [4]  DE AD BE EF, with direction and text or not.
_PRINTED = re.compile(
    _STAMP + r"\s+(\S+)\s+(?:(?:TX|RX)\b[\sA-Z-]*\s)?([0-9A-Fa-f]{3,8})\s+\[(\d+)\]\s*"
    r"((?:[0-9A-Fa-f]{2}(?:\s|$))*|remote request)"
)
_FALLING = 0.1  # of the steps from stamp to stamp
_SUFFIXES = (".asc", ".blf", ".trc")  # where the beginning does not say it


@dataclass(frozen=True, eq=False)
class Frames:
    """Data frames of one bus in the order of the log: stamps (n,) in s, identifiers (n,), data."""

    path: Path
    time_s: Array
    can_id: NDArray[np.int64]
    data: tuple[bytes, ...]
    number: NDArray[np.int64]  # line or number of each frame in the file, (n,)
    counted: str  # what `number` counts: "line" or "frame"
    kind: str  # what kind of log it is

    def __len__(self) -> int:
        return len(self.data)

    def place(self, index: int) -> str:
        """Where a frame stands in the file, for messages."""
        return f"{self.path}: {self.counted} {self.number[index]}"


@dataclass
class _Collected:
    """Frames on their way in, of all buses."""

    time: list[float]
    can_id: list[int]
    data: list[bytes]
    number: list[int]
    channel: list[str]

    def add(self, time: float, can_id: int, data: bytes, number: int, channel: str) -> None:
        self.time.append(time)
        self.can_id.append(can_id)
        self.data.append(data)
        self.number.append(number)
        self.channel.append(channel)


def log_kind(path: Path, bus_logging: bool = False) -> str | None:
    """What kind of CAN log a file is, by its first bytes; None where it is none, or cannot be read.

    An MDF holds signals as a rule; with `bus_logging` it is taken for one that holds frames.
    """
    try:
        with _opened(path) as file:
            head = file.read(_HEAD_BYTES)
    except (OSError, EOFError):
        return None
    text = head.decode("utf-8", errors="replace").lstrip("\ufeff")
    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    asc = first.lower().startswith("date ") and re.search(r"^\s*base\s+(hex|dec)", text, re.M | re.I)
    signs = {
        "BLF": head.startswith(b"LOGG"),
        "MDF4": head.startswith(b"MDF ") and bus_logging,
        "candump": _LOGGED.match(first) or _PRINTED.match(first),
        "TRC": ";$FILEVERSION" in text,
        "ASC": asc,
    }
    suffixes = [suffix.lower() for suffix in path.suffixes if suffix.lower() != ".gz"]
    by_name = suffixes[-1][1:].upper() if suffixes and suffixes[-1] in _SUFFIXES else None
    return next((kind for kind, there in signs.items() if there), by_name)


def read_frames(path: Path, channel: str | None = None) -> Frames:
    """The data frames of one bus. Raises InputError, naming line or frame, for a log that is damaged, that holds none,
    or that holds several buses of which none is named."""
    if not path.is_file():
        raise InputError(str(path), "there is no such file", "Check the path.")
    kind = log_kind(path, bus_logging=True)
    if kind is None:
        raise InputError(
            str(path), "is no CAN log that is known", "Give a log of candump, or ASC, BLF, TRC or MDF4."
        )
    found = _Collected([], [], [], [], [])
    if kind == "candump":
        _read_candump(path, found)
    elif kind == "MDF4":
        _read_mdf(path, found)
    else:
        _read_by_library(path, kind, found)
    channels = sorted(set(found.channel))
    if not channels:
        raise InputError(str(path), "holds no data frames", "Log again, with all identifiers.")
    if channel is None and len(channels) > 1:
        raise InputError(str(path), f"holds frames of several buses ({', '.join(channels)})",
                         f"Say which one: --channel {channels[0]}.")  # fmt: skip
    wanted = channels[0] if channel is None else channel
    if wanted not in channels:
        raise InputError(
            f"{path}: --channel {wanted}", "there is no such bus", f"There are: {', '.join(channels)}."
        )
    kept = [k for k, each in enumerate(found.channel) if each == wanted]
    return Frames(
        path=path,
        time_s=_since_one_instant(np.array(found.time, dtype=np.float64))[kept],
        can_id=np.array(found.can_id, dtype=np.int64)[kept],
        data=tuple(found.data[k] for k in kept),
        number=np.array(found.number, dtype=np.int64)[kept],
        counted="line" if kind == "candump" else "frame",
        kind=kind,
    )


def _since_one_instant(stamps: Array) -> Array:
    """Stamps (n,) that count from the frame before (`candump -t d`) added up: they fall as often as they grow, while
    those of a clock hardly ever do."""
    falls = float(np.mean(np.diff(stamps) < 0)) if stamps.size > 1 else 0.0
    return np.asarray(np.cumsum(stamps)) if falls > _FALLING else stamps


def _seconds(stamp: str) -> float:
    """A stamp in s, of a date since 1970 as if it were UTC. Raises ValueError for none."""
    return datetime.fromisoformat(f"{stamp}+00:00").timestamp() if "-" in stamp else float(stamp)


def _opened(path: Path) -> IO[bytes]:
    with path.open("rb") as file:
        zipped = file.read(2) == _GZIP
    return cast(IO[bytes], gzip.open(path)) if zipped else path.open("rb")


def _read_candump(path: Path, found: _Collected) -> None:
    """Line by line; a last line without its end (the disk was full, the program killed) is left out."""
    broken: int | None = None
    for number, line in enumerate(_lines(path), start=1):
        text = line.strip()
        if not text or not line.endswith("\n"):
            continue
        if broken is not None:
            break
        logged = _LOGGED.match(text)
        if logged is not None:
            stamp, channel, name, payload = logged[1], logged[2], logged[3], logged[4]
            if payload[:1] in ("r", "R", "#"):
                continue  # a remote request, or CAN FD: neither is CANopen's
        else:
            printed = _PRINTED.match(text)
            if printed is None:
                broken = number
                continue
            stamp, channel, name, payload = printed[1], printed[2], printed[3], printed[5]
            if payload.startswith("remote"):
                continue
        try:
            data, time = bytes.fromhex(payload), _seconds(stamp)
        except ValueError:
            broken = number
            continue
        can_id = int(name, 16)
        if len(name) > 3:
            if can_id & 0x20000000:
                continue  # an error frame
            can_id = can_id & 0x1FFFFFFF | EXTENDED
        found.add(time, can_id, data, number, channel)
    else:
        return
    raise InputError(f"{path}: line {broken}", "is no frame of a candump log", "Correct or remove that line.")


def _lines(path: Path) -> Iterator[str]:
    try:
        with _opened(path) as file:
            for line in file:
                yield line.decode("utf-8", errors="replace").lstrip("\ufeff")
    except (OSError, EOFError) as error:
        raise InputError(str(path), f"cannot be read to its end ({error})", "Copy it again.") from None


def _read_mdf(path: Path, found: _Collected) -> None:
    """Frames of ASAM's bus logging: structures CAN_DataFrame, with ID, IDE, DataLength and DataBytes."""
    with mdf.opened(path) as file:
        for group in range(len(file.groups)):
            names = {channel.name for channel in file.groups[group].channels}
            if "CAN_DataFrame.ID" not in names or not file.groups[group].channel_group.cycles_nr:
                continue

            def part(name: str, group: int = group) -> Any:
                return file.get(f"CAN_DataFrame.{name}", group=group)

            identifier = part("ID")
            extended = part("IDE").samples if "CAN_DataFrame.IDE" in names else identifier.samples > 0x7FF
            length = part("DataLength" if "CAN_DataFrame.DataLength" in names else "DLC").samples
            data = part("DataBytes").samples
            bus = part("BusChannel").samples if "CAN_DataFrame.BusChannel" in names else [0] * len(data)
            ids = (identifier.samples.astype(np.int64) & 0x1FFFFFFF) | np.where(extended, EXTENDED, 0)
            for k, stamp in enumerate(identifier.timestamps.tolist()):
                found.add(stamp, int(ids[k]), bytes(data[k][: length[k]]), k + 1, str(bus[k]))


def _read_by_library(path: Path, kind: str, found: _Collected) -> None:
    import can  # noqa: PLC0415  (slow to import, and most imports are tables)

    makers: dict[str, Callable[..., Any]] = {
        "BLF": can.BLFReader, "ASC": can.ASCReader, "TRC": can.TRCReader
    }  # fmt: skip
    number = 0
    try:
        with _opened(path) as raw:
            opened: Any = raw
            if kind in ("ASC", "TRC"):
                opened = io.TextIOWrapper(raw, encoding="utf-8", errors="replace")
            options = {"relative_timestamp": False} if kind == "ASC" else {}
            for message in makers[kind](opened, **options):
                number += 1
                if message.is_error_frame or message.is_remote_frame or message.is_fd:
                    continue
                can_id = message.arbitration_id | (EXTENDED if message.is_extended_id else 0)
                found.add(message.timestamp, can_id, bytes(message.data), number, str(message.channel))
    except Exception as error:  # python-can raises nearly anything for damaged logs
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: frame {number + 1}", f"cannot be read as {kind} ({reason})",
                         "Export the log again, or cut it before that frame.") from error  # fmt: skip
