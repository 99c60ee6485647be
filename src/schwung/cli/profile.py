"""`schwung profile`: list, show, check and draft device profiles. Needs no drive."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from schwung.cli.options import Json

if TYPE_CHECKING:
    from schwung.api.profiles import DeviceProfile
    from schwung.cli.console import Terminal

Family = Annotated[str, typer.Argument(metavar="FAMILY|FILE", help="A family's name or a profile.toml.")]
_NODE = 1  # COB-IDs of an EDS are counted from a node; which one does not matter here


def list_(json_output: Json = False) -> None:
    """List the drive families that come with Schwung.

    [bold]Example[/]

      schwung profile list
    """
    from schwung.api.profiles import list_profiles
    from schwung.cli.console import Terminal

    terminal = Terminal(json_output)
    profiles = list_profiles()
    terminal.table(
        "Device profiles",
        ("family", "bus", "proven on", "name"),
        ((p.family, p.protocol, _proven(p), p.name) for p in profiles),
    )
    kept = ("family", "protocol", "name", "verified")
    terminal.result({"profiles": [{key: getattr(p, key) for key in kept} for p in profiles]})


def show(family: Family, json_output: Json = False) -> None:
    """Show what a family can and cannot do, in which units, and where each fact is from.

    [bold]Example[/]

      schwung profile show maxon-epos4
    """
    from rich.markup import escape

    from schwung.api.profiles import CAPABILITIES, load_profile
    from schwung.cli.console import Terminal

    terminal = Terminal(json_output)
    profile = load_profile(family)
    offered = [(name, profile.offers(name)) for name in CAPABILITIES]
    reasons = {name: "" if yes else profile.reason(name) for name, yes in offered}
    terminal.say(
        f"[bold]{escape(profile.name)}[/] ({escape(profile.family)}), {profile.protocol}, "
        f"proven on {_proven(profile)}"
    )
    terminal.say(escape(f"Source: {profile.source}") if profile.source else "No source is given.")
    terminal.table("Quantities", ("", "object", "unit", "source"), _quantities(profile))
    rows = (("can" if yes else "cannot", name, reasons[name]) for name, yes in offered)
    terminal.table("Capabilities", ("", "", ""), rows)
    if profile.quirks:
        terminal.table("Quirks", ("",), ((quirk,) for quirk in profile.quirks))
    terminal.table("Sources", ("part", "source"), profile.sources.items())
    capabilities = [{"name": name, "offered": yes, "reason": reasons[name]} for name, yes in offered]
    terminal.result({**profile.model_dump(mode="json"), "capabilities": capabilities})


def check(
    file: Family,
    eds: Annotated[
        Path | None,
        typer.Option("--eds", help="The manufacturer's EDS or DCF; default: the one beside the profile."),
    ] = None,
    json_output: Json = False,
) -> None:
    """Check a profile: does the EDS bear out what it says, has every fact a source and every gap a reason?

    What is odd in the EDS itself is shown too, with line and remedy, and which units are left to you; neither is a
    mistake of the profile.

    [bold]Examples[/]

      schwung profile check my-drive/profile.toml --eds vendor.eds

      schwung profile check maxon-epos4 --eds EPOS4.eds
    """
    from schwung.api.configurations import read_eds
    from schwung.api.profiles import CanopenProfile, check_profile, left_to_you, load_profile
    from schwung.cli.console import Terminal
    from schwung.errors import InputError

    terminal = Terminal(json_output)
    profile = load_profile(file)
    path = eds or (profile.eds_path if isinstance(profile, CanopenProfile) else None)
    if path is not None and not isinstance(profile, CanopenProfile):
        raise InputError(
            "--eds", f"{profile.family} speaks {profile.protocol}, which has no EDS", "Leave it out."
        )
    dictionary = None if path is None else read_eds(path, _NODE)
    findings = check_profile(profile, dictionary)
    warnings = () if dictionary is None else dictionary.warnings
    if warnings:
        rows = ((f"line {w.line}", f"[{w.section}]", f"{w.problem}. {w.remedy}") for w in warnings)
        terminal.table(f"Odd in {path}", ("", "section", "finding"), rows)
    _show_findings(terminal, findings, f"{profile.family} against {path}" if path else profile.family)
    left = left_to_you(profile)
    if left:
        terminal.table("Left to you: units that whoever has the machine gives", ("", "hint"), left.items())
    errors = sum(1 for finding in findings if finding.severity == "error")
    document = {
        "family": profile.family, "eds": path and str(path), "findings": [vars(f) for f in findings],
        "eds_warnings": [vars(w) for w in warnings], "left_to_you": left,
    }  # fmt: skip
    if errors:
        failure = InputError(
            file,
            f"{errors} statement{'s do' if errors > 1 else ' does'} not hold",
            "Mend them as said above.",
        )
        vars(failure)["document"] = document
        raise failure
    terminal.result(document)


def new(
    eds: Annotated[Path, typer.Option("--eds", help="The manufacturer's EDS or DCF.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="The profile.toml to write; default: print it.")
    ] = None,
    family: Annotated[str | None, typer.Option(help="Name of the family; default: from the EDS.")] = None,
    json_output: Json = False,
) -> None:
    """Draft a profile from an EDS, and say what could not be found in it.

    [bold]Examples[/]

      schwung profile new --eds vendor.eds

      schwung profile new --eds vendor.eds -o my-drive/profile.toml
    """
    from rich.markup import escape

    from schwung.api.configurations import read_eds
    from schwung.api.profiles import draft_profile
    from schwung.cli.console import Terminal
    from schwung.errors import InputError
    from schwung.files import replace_file

    terminal = Terminal(json_output)
    if out is not None and out.exists():
        raise InputError(str(out), "exists already", "Give another name, or remove it.")
    folder = out.parent if out is not None else Path()
    draft = draft_profile(read_eds(eds, _NODE), folder, family)
    if out is not None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                str(folder), f"cannot be made ({error.strerror})", "Choose another folder."
            ) from error
        replace_file(out, draft.text)
        terminal.say(escape(f"Written: {out}"))
    elif not json_output:
        print(draft.text)
    terminal.table("Not found in the EDS", ("",), ((sentence,) for sentence in draft.missing))
    terminal.result({"profile": draft.text, "file": out and str(out), "missing": list(draft.missing)})


def _proven(profile: DeviceProfile) -> str:
    return "the bench only" if profile.verified == "bench" else "hardware"


def _quantities(profile: DeviceProfile) -> list[tuple[str, str, str, str]]:
    q = profile.quantities
    rows = []
    for name in type(q).model_fields:
        quantity: Any = getattr(q, name)
        if quantity is not None:
            unit = f"{quantity.scale:.6g} per count" if quantity.unit == "literal" else quantity.unit
            rows.append((name, str(quantity.object), unit, profile.sources.get(f"quantities.{name}", "")))
    return rows


def _show_findings(terminal: Terminal, findings: Any, title: str) -> None:
    from rich.markup import escape

    if not findings:
        terminal.say(f"[green]✓[/] {escape(title)}: nothing to mend.")
        return
    signs = {"error": "[red]✗[/]", "warning": "[yellow]![/]"}
    rows = ((signs[f.severity], f.place, f"{f.problem}. {f.remedy}") for f in findings)
    terminal.table(title, ("", "place", "finding"), rows)
