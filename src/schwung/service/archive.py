"""A run as one file that opens anywhere: everything that it left, what was asked and answered, and its part of the
trail.

    report.html, session.h5, …    the files of the run, as kept
    run.json                      the run, its sessions, estimates, explanations and exports
    machine/                      the machine.toml that was believed, with its tables
    trail.json                    every entry of the trail up to now, so that the chain can be checked from its
    first entry SHA256SUMS                    of all of these; `sha256sum -c SHA256SUMS`
    README.txt                    what is what
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from dataclasses import asdict
from pathlib import Path

from schwung.files import json_text
from schwung.service.audit import Trail
from schwung.service.store import Store

_README = """\
One run of Schwung (https://doi.org/10.1007/s44245-024-00036-9), kept whole.

Begin with report.html, where there is one: it opens in any browser and needs nothing else.
session.h5 is HDF5: groups /run/0000, 0001, ...; every dataset has its unit as an attribute.
run.json is what was asked for and what came of it; machine/ is what was believed of the machine.
trail.json is who did what. The hash of each entry is the SHA-256 of its other fields as JSON with sorted keys
(UTF-8, not escaped, ", " and ": " between), and `before` is the hash of the entry before it, 64 zeros for the first.
SHA256SUMS lists every file: sha256sum -c SHA256SUMS
"""


def write_archive(store: Store, trail: Trail, run_id: str, target: Path) -> None:
    """Write the archive of a run. Raises NotFoundError; InputError where a file is gone, or not what it was."""
    run = store.run(run_id)
    results = {
        f"{table}s": [asdict(found) for found in store.of_run(table, run_id)]
        for table in ("session", "estimate", "explanation", "export")
    }
    texts = {
        "run.json": json_text({"run": asdict(run), **results}),
        "trail.json": json_text({"entries": [asdict(entry) for entry in trail.entries()]}),
        "README.txt": _README,
    }
    sums: dict[str, str] = {}
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in store.files(run_id):
            sums[file.name] = file.sha256
            archive.write(store.file_path(file.id, check=True), file.name)
        if run.machine_id is not None:
            for path in sorted(store.machine_folder(run.machine_id).iterdir()):
                sums[f"machine/{path.name}"] = hashlib.sha256(path.read_bytes()).hexdigest()
                archive.write(path, f"machine/{path.name}")
        for name, text in texts.items():
            sums[name] = hashlib.sha256(text.encode()).hexdigest()
            archive.writestr(name, text)
        archive.writestr(
            "SHA256SUMS", "".join(f"{digest}  {name}\n" for name, digest in sorted(sums.items()))
        )


def temporary_archive(store: Store, trail: Trail, run_id: str) -> Path:
    """The archive of a run in a file of its own, for who removes it."""
    handle, name = tempfile.mkstemp(suffix=".zip")
    os.close(handle)
    path = Path(name)
    try:
        write_archive(store, trail, run_id, path)
    except BaseException:
        path.unlink()
        raise
    return path
