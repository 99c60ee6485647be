"""What is done in processes of its own (workshop.py): functions of paths and plain values, with plain results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from schwung.service.workshop import Tell


def estimate_session(
    *,
    session: Path,
    machine: Path,
    folder: Path,
    method: str = "auto",
    inversion: str = "complex",
    frequency_hz: float | None = None,
    points: int | None = None,
    tell: Tell,
) -> dict[str, Any]:
    """Estimate; inertia.csv, measured.toml and estimate.json into `folder`. Raises InputError."""
    from schwung.commissioning.bode import with_recorded_gains  # noqa: PLC0415
    from schwung.drivetrain import load_machine, write_inertia_csv, write_machine  # noqa: PLC0415
    from schwung.estimation import estimate  # noqa: PLC0415
    from schwung.estimation.reach import reach_of  # noqa: PLC0415
    from schwung.files import json_text, replace_file  # noqa: PLC0415
    from schwung.session import read_session  # noqa: PLC0415

    tell("Estimating the load inertia", 0.0)
    recorded = read_session(session)
    believed = with_recorded_gains(load_machine(machine), recorded)
    found = estimate(
        recorded, believed, method=method, inversion="magnitude" if inversion == "magnitude" else "complex",
        frequency_hz=frequency_hz, points=points,
    )  # fmt: skip
    reach = reach_of(recorded, believed, found)
    write_inertia_csv(found.table, folder / "inertia.csv")
    load = believed.load.model_copy(
        update={"inertia_kgm2": None, "inertia_table": found.table, "trust": found.trust.verdict}
    )
    write_machine(believed.model_copy(update={"load": load}), folder / "measured.toml")
    document = found.to_json() | {"reach": reach and reach.to_json()}
    replace_file(folder / "estimate.json", json_text(document))
    return {"verdict": found.trust.verdict, "document": document}


def session_summary(*, session: Path, tell: Tell) -> dict[str, Any]:
    """What a recording holds, in numbers. Raises InputError where it is none of ours."""
    from schwung.session import read_session  # noqa: PLC0415

    tell("Reading the recording", 0.0)
    found = read_session(session)
    lengths = [float(run.time_s[-1] - run.time_s[0]) for run in found.runs]
    return {
        "created": found.created,
        "source": found.source,
        "axis": found.axis,
        "references": len(found.references),
        "excited": len(found.excited),
        "duration_s": sum(lengths),
        "cut_short": list(found.partial_reasons),
    }
