"""Files from outside, read in processes of their own (workshop.py): functions of paths and plain values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from schwung.errors import InputError, SchwungError
from schwung.service.work.computing import session_summary
from schwung.service.workshop import Tell


def import_session(
    *, path: Path, what: str, options: dict[str, Any], eds: Path | None, folder: Path, tell: Tell
) -> dict[str, Any]:
    """A file from outside becomes session.h5 in `folder`, checked; returns what it holds.

    `what`: "session", one of ours; "recording", a CSV, TwinCAT Scope, MAT, MDF or Parquet file, and "can_log", with the
    options of a recipe; a log by its `eds` has `node` and `profile` among them. Raises InputError that names what is
    wrong; a file that points to other files is refused.
    """
    from schwung.api.recordings import (
        import_log,
        import_recordings,
        log_kind,
        make_recipe,
        read_any,
        write_any,
        write_session,
    )

    tell("Reading the file", 0.0)
    target = folder / "session.h5"
    with _without_place(folder):
        if what == "session":
            if path.suffix == ".h5":
                _refuse_links(path)
                summary = session_summary(session=path, tell=tell)
                path.replace(target)
                return summary
            write_any(read_any(path), target, False)
            return session_summary(session=target, tell=tell)
        if eds is not None:
            given = dict(options)
            node, profile = given.pop("node", None), given.pop("profile", None)
            if node is not None and not (isinstance(node, int) and 1 <= node <= 127):
                raise InputError("options.node", "is no node id", "Give 1 to 127.")
            _require_family(profile)
            imported = import_log([path], eds, node, profile, given)
        elif what == "can_log" and "dbc" not in options and log_kind(path) is not None:
            raise InputError(path.name, "is a log of a CAN bus", "Bring its EDS or DBC, too.")
        else:
            imported = import_recordings([path], make_recipe(options, "upload"))
        write_session(imported.session, target, overwrite=False)
    return session_summary(session=target, tell=tell) | {"notes": list(imported.notes)}


def guess_columns(*, path: Path, options: dict[str, Any], folder: Path, tell: Tell) -> dict[str, Any]:
    """What the columns of a file seem to be, one proposal per axis, each with its picture in `folder`.

    Raises InputError for what cannot be guessed.
    """
    from schwung.api.recordings import draw_import, guess_imports

    tell("Looking at the columns", 0.0)
    given = dict(options)
    joint = given.pop("joint", None)
    proposals = []
    with _without_place(folder):
        for number, one in enumerate(guess_imports(path, given, joint), start=1):
            picture = f"guess_{number}.png"
            tell("Drawing what they must satisfy", 0.5)
            draw_import(one.proposal, one.imported.session, one.proposal.name, folder / picture)
            own = {key: value for key, value in one.proposal.options.items() if key != "dbc"}
            proposals.append(one.to_json() | {"picture": picture, "options": own})
    return {"proposals": proposals}


def convert_session(*, session: Path, target: Path, tell: Tell) -> dict[str, Any]:
    """A session as MDF4 or Parquet, by the suffix of `target`. Raises InputError where a library is missing."""
    from schwung.api.recordings import FORMATS, read_any, write_any

    tell("Writing the session", 0.0)
    recorded = read_any(session)
    write_any(recorded, target, True)
    return {"format": FORMATS[target.suffix], "runs": len(recorded.runs)}


def check_family(*, family: str, eds: Path | None, tell: Tell) -> dict[str, Any]:
    """What an EDS says of a profile. Raises InputError for an unknown family, and an EDS for a drive that has none."""
    from schwung.api.comparing import dictionary_of
    from schwung.api.profiles import (
        CanopenProfile,
        check_profile,
        left_to_you,
        load_profile,
    )

    tell("Comparing profile and EDS", 0.0)
    _require_family(family)
    profile = load_profile(family)
    if eds is not None and not isinstance(profile, CanopenProfile):
        raise InputError(
            "eds_file_id", f"{family} speaks {profile.protocol}, which has no EDS", "Leave it out."
        )
    dictionary = dictionary_of(eds, profile, 1) if isinstance(profile, CanopenProfile) else None
    warnings = () if dictionary is None else dictionary.warnings
    return {
        "family": family,
        "findings": [vars(finding) for finding in check_profile(profile, dictionary)],
        "eds_warnings": [vars(warning) for warning in warnings],
        "left_to_you": left_to_you(profile),
    }


def draft_family(*, eds: Path, family: str | None, folder: Path, tell: Tell) -> dict[str, Any]:
    """profile.toml in `folder`, drafted from an EDS, and what could not be found in it. Raises InputError."""
    from schwung.api.configurations import read_eds
    from schwung.api.profiles import draft_profile
    from schwung.files import replace_file

    tell("Reading the EDS", 0.0)
    with _without_place(eds.parent):
        draft = draft_profile(read_eds(eds, 1), folder, family)
    replace_file(folder / "profile.toml", draft.text)
    return {"profile": draft.text, "missing": list(draft.missing)}


def reproduce_paper(*, what: list[str], folder: Path, tell: Tell) -> dict[str, Any]:
    """reproduction.md and its pictures in `folder`. Raises InputError for a name that there is not."""
    from schwung.api.reproduction import reproduce

    written = reproduce(what or ["all"], folder, lambda name, _made: tell(f"Made {name}", 0.0))
    for picture in written.pictures:  # a run's files lie in its folder itself
        picture.replace(folder / picture.name)
    text = written.document.read_text(encoding="utf-8").replace("](reproduction/", "](")
    written.document.write_text(text, encoding="utf-8")
    (folder / "reproduction").rmdir()
    return {"reproduced": written.lines}


def _require_family(family: object) -> None:
    from schwung.service.families import require_family

    if family is not None:
        require_family(str(family))


@contextmanager
def _without_place(folder: Path) -> Iterator[None]:
    """Where our files lie is nobody's business: what goes wrong within is told without it."""
    try:
        yield
    except SchwungError as error:
        hidden = f"{folder}/"
        place, problem, remedy = (
            text.replace(hidden, "") for text in (error.place, error.problem, error.remedy)
        )
        raise InputError(place, problem, remedy) from error


def _refuse_links(path: Path) -> None:
    """Raise InputError for an HDF5 file that would have us read others: external links, external or virtual storage."""
    import h5py

    from schwung.errors import InputError

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
