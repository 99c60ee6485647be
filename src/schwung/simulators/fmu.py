"""A machine as an FMU for co-simulation, FMI 2.0 or 3.0: C sources, compiled where a compiler is, and a description.

The equations are `c/machine.c`, the same for every machine; `machine_data.h` is written for this one. FMI's facts are
those of the standards, 2.0.4 and 3.0.2 (https://fmi-standard.org).
"""

from __future__ import annotations

import hashlib
import io
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Literal

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.files import replace_file
from schwung.simulators.description import Variable, build_description, model_description, variables
from schwung.simulators.exported import OF_COUPLING, Exported, exported

FmiVersion = Literal[2, 3]

#: A compiler that takes longer than this is stuck (s).
_LONGEST_S = 120.0
#: So that repeated exports are alike to the last bit: the earliest date that a zip can hold.
_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class WrittenFmu:
    """An FMU that was written; `platform` is None where no compiler was, and only sources are in it."""

    path: Path
    fmi: FmiVersion
    model_identifier: str
    platform: str | None
    parameters: tuple[str, ...]
    note: str = ""


def write_fmu(
    machine: Machine, path: str | Path, *, fmi: FmiVersion = 2, start_rad: float | None = None
) -> WrittenFmu:
    """Write a machine as an FMU for co-simulation: motor torque (N·m) in, angles (rad) and speeds (rad/s) out.

    Args:
        machine: with a load inertia; everything in its [[physics]] is in the FMU, too.
        path: the file, `*.fmu`; replaced all at once.
        fmi: 2 or 3.
        start_rad: motor angle at which it stands first; None: the middle of the inertia's table, or 0.

    Raises InputError where the machine cannot be simulated, or the file not be written.
    """
    path = Path(path)
    told = exported(machine, start_rad)
    listed = variables(told)
    sources = {name: _source(name) for name in ("machine.c", "machine.h", f"fmi{fmi}.c")}
    tables = [rows.tolist() for rows in (*told.tables.values(), *told.planes.values())]
    content = repr((fmi, told.name, listed, tables, sources))
    token = str(uuid.UUID(hashlib.sha256(content.encode()).hexdigest()[:32]))
    token = token if fmi == 3 else f"{{{token}}}"
    sources["machine_data.h"] = _data(told, listed, token)
    units = ("machine.c", f"fmi{fmi}.c")
    files: dict[str, bytes] = {
        "modelDescription.xml": model_description(told, listed, fmi, token, units),
        **{f"sources/{name}": text.encode() for name, text in sources.items()},
    }
    if fmi == 3:
        files["sources/buildDescription.xml"] = build_description(told.identifier, units)
    built, note = _compiled(sources, units)
    place = _platform(fmi)
    if built is not None:
        files[f"binaries/{place}/{told.identifier}{_ending()}"] = built
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, held in files.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), held, zipfile.ZIP_DEFLATED)
    replace_file(path, packed.getvalue())
    return WrittenFmu(
        path,
        fmi,
        told.identifier,
        place if built is not None else None,
        tuple(p.name for p in told.parameters),
        note,
    )


def _source(name: str) -> str:
    return (resources.files("schwung.simulators") / "c" / name).read_text(encoding="utf-8")


def _data(told: Exported, listed: tuple[Variable, ...], token: str) -> str:
    """machine_data.h: variables by number, values at first, tables."""
    known = [one.name.upper() for one in listed]
    of_coupling = ("coupling_stiffness_nm_rad", "coupling_damping_nms", *OF_COUPLING)
    absent = [name.upper() for name in of_coupling if name.upper() not in known]
    outputs = [one.name.upper() for one in listed if one.causality == "output"]
    lines = [
        "/* One machine, written by Schwung: variables by value reference, values at first, tables. */",
        f'#define TOKEN "{token}"',
        f"#define RIGID {int(told.rigid)}",
        "",
        "enum {",
        *(f"    {name}," for name in (*known, *absent)),
        "    N_VARIABLES,",
        f"    FIRST_OUTPUT = {outputs[0]},",
        f"    LAST_OUTPUT = {outputs[-1]}",
        "};",
        "",
        "static const double START[N_VARIABLES] = {",
        *(f"    [{one.name.upper()}] = {one.start!r}," for one in listed if one.start),
        "};",
    ]
    for name, rows in told.tables.items():
        lines += ["", f"static const double {name.upper()}[][3] = {{ /* angle, value, slope */"]
        lines += [f"    {{{angle!r}, {value!r}, {slope!r}}}," for angle, value, slope in rows.tolist()]
        lines += ["};"]
    for name, rows in told.planes.items():
        lines += [
            "",
            f"static const double {name.upper()}[][{rows.shape[1]}] = {{ /* points above and left, torque */",
        ]
        lines += [f"    {{{', '.join(repr(x) for x in row)}}}," for row in rows.tolist()]
        lines += ["};"]
    return "\n".join(lines) + "\n"


def _compiled(sources: dict[str, str], units: tuple[str, ...]) -> tuple[bytes | None, str]:
    """The library for this platform, and why there is none."""
    compiler = next(
        (
            found
            for name in (os.environ.get("CC"), "cc", "gcc", "clang")
            if name and (found := shutil.which(name))
        ),
        None,
    )
    if compiler is None:
        return None, "no C compiler was found (cc, gcc, clang): the FMU has its sources only"
    with tempfile.TemporaryDirectory(prefix="schwung-fmu-") as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        library = f"machine{_ending()}"
        command = [compiler, "-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared"]
        command += [] if sys.platform == "win32" else ["-fPIC"]
        command += ["-o", library, *units, *([] if sys.platform == "win32" else ["-lm"])]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, timeout=_LONGEST_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return None, f"{compiler} did not run ({error}): the FMU has its sources only"
        if done.returncode != 0:
            first = next(
                (line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200]
            )
            return None, f"{compiler} did not compile it ({first}): the FMU has its sources only"
        return (Path(folder) / library).read_bytes(), ""


def _ending() -> str:
    return {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def _platform(fmi: FmiVersion) -> str:
    """This platform's folder: FMI 2.0.4 section 2.3, FMI 3.0.2 section 2.5.1.4."""
    wide = sys.maxsize > 2**32
    if fmi == 2:
        system = {"win32": "win", "darwin": "darwin"}.get(sys.platform, "linux")
        return f"{system}{64 if wide else 32}"
    machine = platform.machine().lower()
    chip = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{chip}-{ {'win32': 'windows', 'darwin': 'darwin'}.get(sys.platform, 'linux') }"


def check_fmi(version: int) -> FmiVersion:
    """The version as one that can be written. Raises InputError for others."""
    if version == 2:
        return 2
    if version == 3:
        return 3
    raise InputError("--fmi", f"is {version}", "Give 2 (FMI 2.0) or 3 (FMI 3.0).")
