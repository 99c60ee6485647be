"""What is done in processes of its own (workshop.py): functions of paths and plain values, with plain results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from schwung.service.workshop import Tell

if TYPE_CHECKING:
    from schwung.drivetrain import Machine
    from schwung.optimise.values import Task


def estimate_session(
    *,
    session: Path,
    machine: Path,
    folder: Path,
    method: str = "auto",
    inversion: str = "complex",
    frequency_hz: float | None = None,
    points: int | None = None,
    beside: dict[str, Any] | None = None,
    tell: Tell,
) -> dict[str, Any]:
    """Estimate; inertia.csv, measured.toml, estimate.json and report.html into `folder`. Raises InputError.

    beside: what else estimate.json shall say, e.g. the plan and the checks of a commissioning, which the report shows.
    """
    from schwung.api.reports import content_of, standard_of, write_page  # noqa: PLC0415
    from schwung.commissioning.preflight import with_recorded_gains  # noqa: PLC0415
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
    replace_file(folder / "estimate.json", json_text((beside or {}) | document))
    tell("Writing the report", 0.0)
    write_page(
        content_of(recorded, believed, found, standard_of(believed, None), folder), folder / "report.html"
    )
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


def explain_session(*, session: Path, machine: Path, folder: Path, tell: Tell) -> dict[str, Any]:
    """Explain; explanation.json, machine.toml (learned) and explanation.html into `folder`. Raises InputError."""
    from schwung.api.reports import write_explanation  # noqa: PLC0415
    from schwung.commissioning.preflight import with_recorded_gains  # noqa: PLC0415
    from schwung.drivetrain import load_machine  # noqa: PLC0415
    from schwung.explain.explain import explain  # noqa: PLC0415
    from schwung.files import json_text, replace_file  # noqa: PLC0415
    from schwung.session import read_session  # noqa: PLC0415

    recorded = read_session(session)
    believed = with_recorded_gains(load_machine(machine), recorded)
    found = explain(recorded, believed, progress=tell)
    document = found.to_json()
    replace_file(folder / "explanation.json", json_text(document))
    write_explanation(found, recorded, believed, folder)
    return {"verdict": found.verdict, "document": document}


def fit_bode_session(
    *,
    session: Path,
    machine: Path,
    folder: Path,
    torque_max_nm: float | None,
    distance_rad: float | None,
    duration_s: float,
    tell: Tell,
) -> dict[str, Any]:
    """Fit frequency responses, propose what to inject; bode.json, machine.toml and report.html into `folder`.

    Raises InputError where the recording allows no fit.
    """
    from schwung.commissioning.bode_result import BODE_FILE, FORMAT, VERSION  # noqa: PLC0415
    from schwung.commissioning.preflight import with_recorded_gains  # noqa: PLC0415
    from schwung.drivetrain import load_machine, write_machine  # noqa: PLC0415
    from schwung.estimation.bode import fit_bode  # noqa: PLC0415
    from schwung.estimation.proposal import Stroke, propose  # noqa: PLC0415
    from schwung.estimation.response import measured_responses  # noqa: PLC0415
    from schwung.files import json_text, replace_file  # noqa: PLC0415
    from schwung.report.bode import BodeContent, write_bode_report  # noqa: PLC0415
    from schwung.session import read_session  # noqa: PLC0415

    tell("Fitting the responses", 0.0)
    recorded = read_session(session)
    believed = with_recorded_gains(load_machine(machine), recorded)
    fit = fit_bode(measured_responses(recorded), believed)
    fitted = fit.machine(believed)
    way = distance_rad or fit.angles[-1].position_rad - fit.angles[0].position_rad
    stroke = Stroke(way, duration_s) if way else None
    proposal = None
    if fitted.control is not None:
        proposal = propose(fit, fitted, fit.responses[0].sample_rate_hz, torque_max_nm, stroke)
    write_machine(fitted, folder / "machine.toml")
    title = f"{believed.name}: frequency response at standstill"
    write_bode_report(BodeContent(title, recorded, fit, believed, proposal, ()), folder / "report.html")
    proposed = proposal and proposal.to_json() | {"stroke": stroke and vars(stroke)}
    document = {"format": FORMAT, "version": VERSION} | fit.to_json() | {"proposal": proposed}
    replace_file(folder / BODE_FILE, json_text(document))
    return document


def optimise_motion(
    *, machine: Path, folder: Path, asked: dict[str, Any], sample_rate_hz: float, tell: Tell
) -> dict[str, Any]:
    """Find the best motion of `task_of(machine, asked)`; setpoints, cams and pictures into `folder`. Raises
    InputError."""
    from schwung.api.optimising import optimise, write_optimised  # noqa: PLC0415
    from schwung.drivetrain import load_machine  # noqa: PLC0415
    from schwung.files import json_text, replace_file  # noqa: PLC0415

    tell("Finding the motion", 0.0)
    believed = load_machine(machine)
    found = optimise(believed, task_of(believed, asked), rivals=asked["rivals"])
    document = found.to_json()
    write_optimised(found, folder, sample_rate_hz, document)
    replace_file(folder / "optimised.json", json_text(document))
    return document


def task_of(machine: Machine, asked: dict[str, Any]) -> Task:
    """What is asked of a motion, by the fields of OptimiseRequest. Raises InputError where that is no task."""
    from schwung.optimise.values import MotionLimits, Task  # noqa: PLC0415

    limits = dict(asked["limits"])
    torque = limits.pop("torque_max_nm") or machine.motor.peak_torque_nm
    return Task(
        start_rad=asked["start_rad"],
        distance_rad=asked["distance_rad"],
        limits=MotionLimits(torque_max_nm=torque, jerk_max_rad_s3=asked["jerk_max_rad_s3"], **limits),
        duration_s=asked["duration_s"],
        weights=asked["weights"],
        payloads_kgm2=(0.0, *asked["payloads_kgm2"]),
        band_sigmas=2.0 if asked["robust"] else 0.0,
    )


def import_session(
    *, path: Path, what: str, options: dict[str, Any], folder: Path, tell: Tell
) -> dict[str, Any]:
    """A file from outside becomes session.h5 in `folder`, checked; returns what it holds.

    `what`: "session", one of ours; "recording", a CSV, TwinCAT Scope, MAT, MDF or Parquet file with the options of a
    recipe. Raises InputError that names what is wrong; a file that points to other files is refused.
    """
    from schwung.errors import InputError, SchwungError  # noqa: PLC0415
    from schwung.session.imports import import_recordings, make_recipe, write_session  # noqa: PLC0415

    tell("Reading the file", 0.0)
    target = folder / "session.h5"
    try:
        if what == "session":
            _refuse_links(path)
            summary = session_summary(session=path, tell=tell)
            path.replace(target)
            return summary
        imported = import_recordings([path], make_recipe(options, "upload"))
        write_session(imported.session, target, overwrite=False)
    except SchwungError as error:
        hidden = f"{folder}/"
        place, problem, remedy = (
            text.replace(hidden, "") for text in (error.place, error.problem, error.remedy)
        )
        raise InputError(place, problem, remedy) from error
    return session_summary(session=target, tell=tell) | {"notes": list(imported.notes)}


def _refuse_links(path: Path) -> None:
    """Raise InputError for an HDF5 file that would have us read others: external links, external or virtual storage."""
    import h5py  # noqa: PLC0415

    from schwung.errors import InputError  # noqa: PLC0415

    remedy = "Send a file that Schwung wrote."
    try:
        with h5py.File(path, "r") as file:
            groups = [file]
            while groups:
                group = groups.pop()
                for name in group:
                    link = group.get(name, getlink=True)
                    if not isinstance(link, h5py.HardLink):
                        raise InputError(
                            f"session: {group.name}", f"has a link, {name}, to elsewhere", remedy
                        )
                    item = group[name]
                    if isinstance(item, h5py.Group):
                        groups.append(item)
                    elif isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
                        raise InputError(f"session: {item.name}", "is stored in another file", remedy)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise InputError("session", "is no HDF5 file, or damaged", remedy) from error
