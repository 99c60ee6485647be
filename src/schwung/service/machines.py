"""Machines that come from outside: their tables get our names, so that no name of theirs reaches the file system."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

import tomli_w

from schwung.api.computing import load_machine
from schwung.api.values import Machine
from schwung.errors import InputError, SchwungError
from schwung.files import replace_file

#: Keys of [load] that name a file, and the name that it gets here.
TABLES = {"inertia_table": "inertia.csv", "torque_table": "load_torque.csv"}


def write_machine_files(folder: Path, toml: str, tables: Mapping[str, str]) -> Machine:
    """Write machine.toml and its tables into a folder of ours and read them again.

    tables: content of each table by its key in [load]. Raises InputError where toml or tables are not sound;
    nothing of the folder's name is in what it says.
    """
    try:
        content = tomllib.loads(toml)
    except (ValueError, RecursionError) as error:
        raise InputError("machine.toml", f"is not TOML: {error}", "Correct that line.") from error
    load = content.get("load")
    load = load if isinstance(load, dict) else {}
    for key, name in TABLES.items():
        if key in load:
            if key not in tables:
                raise InputError(
                    f"machine.toml: load.{key}",
                    "names a table that did not come along",
                    "Send its content, too.",
                )
            load[key] = name
            replace_file(folder / name, tables[key])
        elif key in tables:
            raise InputError(
                f"machine.toml: load.{key}", "is not there, but a table came for it", "Name it in [load]."
            )
    try:
        replace_file(folder / "machine.toml", tomli_w.dumps(content))
        return load_machine(folder / "machine.toml")
    except SchwungError as error:
        hidden = f"{folder}/"
        raise InputError(
            error.place.replace(hidden, ""),
            error.problem.replace(hidden, ""),
            error.remedy.replace(hidden, ""),
        ) from error
