"""Files that are there whole or not at all, and JSON that everybody can read."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from schwung.errors import InputError


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a whole file or leave it as it was: into a temporary one beside it, which then takes its place.

    The content is on the disk before the old file goes, and the exchange itself is once this returns: neither a
    killed process nor a power cut leaves half a file. Raises InputError where it cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            umask = os.umask(0)  # mkstemp makes files that only their owner may read
            os.umask(umask)
            os.chmod(temporary, 0o666 & ~umask)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
        _sync_directory(path.parent)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), f"cannot be written: {reason}", "Choose another place.") from None


def _sync_directory(directory: Path) -> None:
    """Make a rename survive a power cut; where no directory can be opened (Windows) the rename must do."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def json_text(document: Mapping[str, Any]) -> str:
    """A document as strict JSON: what is not finite becomes null, what JSON does not know becomes text."""
    return json.dumps(_strict(document), indent=2, default=str, allow_nan=False)


def _strict(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
