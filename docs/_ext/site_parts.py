"""Parts of the site: formulas as pictures (no script, nothing fetched), and the reference, made of the code itself."""

from __future__ import annotations

import inspect
import io
import posixpath
import re
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any
from zlib import crc32

import typer
from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import math_to_image
from sphinx.application import Sphinx

import schwung
from schwung.cli import app as command_line

#: The names of `import schwung`, as somebody looks for them.
GROUPS = {
    "Drives": ("connect", "scan", "doctor", "Connection"),
    "Planning and moving": ("Wishes", "LimitWishes", "plan", "Plan", "Check", "commission", "Commissioned", "Observer"),
    "Into the drive": ("plan_export", "export", "Exported"),
    "Sessions and machines": (
        "read_session", "Session", "Run", "load_machine", "write_machine", "example_machine", "Machine", "read_inertia",
        "write_inertia", "InertiaTable",
    ),
    "Estimating and explaining": ("estimate", "Estimate", "explain", "Explanation", "write_report"),
    "Simulating and optimising": (
        "Motion", "Excitation", "simulate", "Simulated", "MotionLimits", "Task", "optimise", "Optimised",
    ),
}  # fmt: skip


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_html_math_renderer("pictures", (_inline_math, None), (_block_math, None))
    app.connect("builder-inited", write_reference)
    app.connect("source-read", without_links_out)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


_POINTS = 12.5  # of formulas: they stand in text of 16 px


def _inline_math(writer: Any, node: nodes.math) -> None:
    writer.body.append(formula(node.astext()))
    raise nodes.SkipNode


def _block_math(writer: Any, node: nodes.math_block) -> None:
    drawn = formula(node.astext().replace(r"\frac", r"\dfrac"), 1.15)
    writer.body.append(f'<div class="formula" tabindex="0">{drawn}</div>')
    raise nodes.SkipNode


def formula(tex: str, scale: float = 1.0) -> str:
    """TeX as an SVG element in the colour of the text around; its text is read out."""
    buffer = io.BytesIO()
    font = FontProperties(size=_POINTS * scale, math_fontfamily="stix")
    depth = math_to_image(
        f"${' '.join(tex.split())}$", buffer, prop=font, dpi=72, format="svg", color="#123456"
    )
    svg = buffer.getvalue().decode("utf-8")
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    name = f"m{crc32(tex.encode()):x}{scale:g}".replace(".", "")
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", svg).replace("#123456", "currentColor")
    svg = re.sub(r'<g id="[^"]*patch_1">.*?</g>', "", svg, count=1, flags=re.DOTALL)  # the white ground
    width, height = (float(size) * 4 / 3 for size in re.findall(r'(?:width|height)="([\d.]+)pt"', svg)[:2])
    box = re.search(r'viewBox="[^"]*"', svg)
    assert box is not None
    style = f"width:{width:.1f}px;height:{height:.1f}px;vertical-align:-{depth * 4 / 3:.1f}px"
    opening = f'<svg class="math" {box[0]} style="{style}" role="img" aria-label="{escape(tex)}">'
    return re.sub(r"<svg [^>]*>", lambda _: opening, svg, count=1)


def without_links_out(_app: Sphinx, name: str, source: list[str]) -> None:
    """Links to files beside docs/ are for readers of the repository: the site keeps their words."""

    def kept(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(name), link[2]))
        return link[1] if target.startswith("..") else link[0]

    source[0] = re.sub(r"\[([^\]]+)\]\((\.\./[^)]+)\)", kept, source[0])


def write_reference(app: Sphinx) -> None:
    """reference/names.md and reference/commands.md, anew."""
    folder = Path(app.srcdir) / "reference"
    _write(folder / "names.md", names_page())
    _write(folder / "commands.md", commands_page())


def _write(path: Path, text: str) -> None:
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def names_page() -> str:
    """Every public name by its docstring. Raises ValueError where a name stands in no group."""
    errors = [name for name in schwung.__all__ if inspect.isclass(getattr(schwung, name))
              and issubclass(getattr(schwung, name), BaseException)]  # fmt: skip
    grouped = {name for names in GROUPS.values() for name in names}
    missing = set(schwung.__all__) - grouped - set(errors) - {"__version__"}
    if missing:
        raise ValueError(f"no group of the reference holds {', '.join(sorted(missing))}")
    lines = [
        "# Names of `import schwung`",
        "",
        "How they play together: [Schwung in Python](../python.md).",
        "",
    ]
    for title, names in (GROUPS | {"Errors": tuple(errors)}).items():
        lines += [f"## {title}", ""]
        for name in names:
            kind = "autoclass" if inspect.isclass(getattr(schwung, name)) else "autofunction"
            members = ["   :members:"] if kind == "autoclass" and title != "Errors" else []
            lines += ["```{eval-rst}", f".. {kind}:: schwung.{name}", *members, "```", ""]
    return "\n".join(lines)


def commands_page() -> str:
    """Every command as the command line itself describes it."""
    root = typer.main.get_command(command_line)
    lines = ["# Commands", "", "Every command has `--help`, and `--json` for machines.", ""]
    for path, command in _commands(root, ()):
        lines += [f"## schwung {' '.join(path)}", "", _prose(command.help or ""), ""]
        rows = [_row(parameter) for parameter in command.params if not getattr(parameter, "hidden", False)]
        lines += ["| option | what it does | default |", "|---|---|---|", *rows, ""]
    return "\n".join(lines)


def _commands(group: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, (*path, name))
        else:
            yield (*path, name), command


def _prose(text: str) -> str:
    """Rich's markup as Markdown; indented lines are commands."""
    text = re.sub(r"\[bold\](.*?)\[/\]", r"**\1**", inspect.cleandoc(text))
    out: list[str] = []
    for line in text.splitlines():
        out.append(f"    {line.strip()}" if line.startswith("  ") else line)
    return "\n".join(out)


def _row(parameter: Any) -> str:
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    if parameter.param_type_name == "argument":
        names = f"`{parameter.metavar or parameter.name.upper()}`"
    default = parameter.default
    plain = bool(default) and not callable(default)
    words = getattr(parameter, "help", "") or ""
    told = f"`{default}`" if plain and parameter.param_type_name != "argument" else ""
    return f"| {names} | {_cell(words)} | {'required' if parameter.required else told} |"


def _cell(text: str) -> str:
    return re.sub(r"\[/?\w*\]", "", text).replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")
