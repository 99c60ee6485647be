"""CAN logs by a DBC (or KCD, SYM, ARXML, whatever cantools reads): every signal a column in physical units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schwung.errors import InputError
from schwung.extras import require
from schwung.session.imports.canframes import EXTENDED, Frames, read_frames
from schwung.session.imports.table import Column, Table


def read_by_dbc(path: Path, dbc: Path, channel: str | None = None) -> Table:
    """The signals of a log as columns `Message.Signal`, each on the stamps of its own frames.

    Raises InputError for a DBC that is none, a frame that it cannot decode (naming it), or a log without any message
    that it describes.
    """
    database = _database(dbc)
    frames = read_frames(path, channel)
    columns: list[Column] = []
    for can_id in np.unique(frames.can_id).tolist():
        try:
            message = database.get_message_by_frame_id(can_id & ~EXTENDED)
        except KeyError:
            continue
        if bool(message.is_extended_frame) == bool(can_id & EXTENDED):
            columns += _columns(frames, can_id, message)
    if not columns:
        known = ", ".join(f"0x{message.frame_id:X}" for message in database.messages[:8])
        raise InputError(
            str(path),
            f"holds no message that {dbc.name} describes",
            f"It describes {known}: give the DBC of this bus.",
        )
    return Table(path, tuple(columns), described=f"{frames.kind} by {dbc.name}")


def _database(dbc: Path) -> Any:
    require("--dbc", "logs", "cantools")
    import cantools  # noqa: PLC0415  (an extra, and slow to import)

    if not dbc.is_file():
        raise InputError(str(dbc), "there is no such file", "Give an existing DBC.")
    try:
        database: Any = cantools.database.load_file(str(dbc))
        _ = database.messages
    except Exception as error:  # cantools raises nearly anything for damaged files
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            str(dbc), f"is no CAN database that could be read ({reason})", "Export it again."
        ) from None
    return database


def _columns(frames: Frames, can_id: int, message: Any) -> list[Column]:
    """The signals of one message; multiplexed ones have the stamps at which they were there."""
    places = np.flatnonzero(frames.can_id == can_id)
    values: dict[str, list[float]] = {signal.name: [] for signal in message.signals}
    stamps: dict[str, list[float]] = {name: [] for name in values}
    for k in places.tolist():
        try:
            decoded = message.decode(frames.data[k], decode_choices=False)
        except Exception as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(
                frames.place(k), f"is no {message.name} as the database describes it ({reason})",
                "Give the database of this bus.",
            ) from None  # fmt: skip
        for name, value in decoded.items():
            if isinstance(value, int | float):
                values[name].append(float(value))
                stamps[name].append(float(frames.time_s[k]))
    return [
        Column(f"{message.name}.{signal.name}", np.array(values[signal.name]), signal.unit or "",
               time_s=np.array(stamps[signal.name]))
        for signal in message.signals
        if values[signal.name]
    ]  # fmt: skip
