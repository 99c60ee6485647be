"""The sealed benchmark of `schwung explain`: random machines hide physics, and nobody but the score knows which.

    python benchmarks/explain.py generate --out DIR --cases 24 --kind single
    python benchmarks/explain.py run      --out DIR
    python benchmarks/explain.py score    --out DIR
    git worktree add /tmp/former 8e216f2; python benchmarks/explain.py run --out DIR --former /tmp/former
                                                            by tests against thresholds, for `score` to put beside
    python benchmarks/explain.py all      --out DIR --cases 24 --kind single     the first three
    python benchmarks/explain.py control  --out DIR         the drop without, with wrong [control], same sessions
    python benchmarks/explain.py likeness --out DIR         of wrong answers: could the truth have been told at all

`generate` draws machines in the virtual machine room, which shares no code with the tool, and writes
DIR/sessions/NNNN/ (session.h5, machine.toml, inertia.csv) and, apart, DIR/sealed/labels.jsonl. Only `score` opens that.
What counts as right is written in explain_truth.py; explain_page.py makes tables of several folders.

An effect's strength is the torque residual that it makes (within 200 Hz, rms over the strokes), over the noise floor:
the same residual of the noise alone, with the best combination of reported position and speed. weak: 3, clear: 8 to 30,
gross: 30 to 100 floors, evenly in the logarithm. Of two or three each is as strong on its own. A foreign effect's
strength is what it makes beyond the named effect that it is most like.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
import traceback
from pathlib import Path

from schwung_sim.sealed import LABELS, CaseWishes, draw_case, likeness_of, read_labels, write_case

KINDS = ("single", "weak", "gross", "two", "three", "none", "foreign")
CONTROLS = ("given", "none", "wrong")
_TIME_LIMIT_S = 300.0
#: The last commit that explained by tests against thresholds, too (`--no-weigh`).
FORMER = "8e216f2"


def wishes_of(options: argparse.Namespace) -> CaseWishes:
    """The kind of the command line as the generator takes it: weak and gross are single effects."""
    level = options.kind if options.kind in ("weak", "gross") else options.level
    kind = "single" if options.kind in ("weak", "gross") else options.kind
    among = tuple(options.effects.split(",")) if options.effects else ()
    return CaseWishes(kind, level, among, options.control)


def generate(options: argparse.Namespace) -> None:
    """Draw, record and write the cases; what the folder held before is replaced."""
    if (options.out / LABELS).exists():
        for folder in ("sessions", "explanations", "former"):
            shutil.rmtree(options.out / folder, ignore_errors=True)
        (options.out / LABELS).unlink()
    wishes = wishes_of(options)
    began = time.perf_counter()
    for number in range(options.cases):
        write_case(draw_case(options.first + number, wishes), options.out, f"{number:04d}")
    taken = time.perf_counter() - began
    print(
        f"{options.cases} sessions in {options.out / 'sessions'}, {taken / options.cases:.1f} s each; labels sealed"
    )


def run(options: argparse.Namespace) -> None:
    """Explain every session that has no explanation yet; it sees the session and the belief, nothing else."""
    sessions = sorted((options.out / "sessions").iterdir())
    for folder in sessions:
        into = options.out / ("former" if options.former else "explanations") / folder.name
        if (into / "run.json").exists() and not options.again:
            continue
        shutil.rmtree(into, ignore_errors=True)
        into.mkdir(parents=True)
        began = time.perf_counter()
        by_call = options.through == "call" and options.former is None
        error = _by_call(folder, into) if by_call else _by_command(folder, into, options.former)
        seconds = time.perf_counter() - began
        if error:
            (into / "error.txt").write_text(error, encoding="utf-8")
        (into / "run.json").write_text(json.dumps({"seconds": seconds}), encoding="utf-8")
        print(f"\r{folder.name} of {len(sessions)}: {seconds:.1f} s", end="", flush=True)
    print()


def _by_call(folder: Path, into: Path) -> str:
    """In this process; returns what went wrong, or nothing."""
    from schwung.drivetrain import load_machine
    from schwung.explain.publishing.publish import publish
    from schwung.session import read_session

    session, machine = read_session(folder / "session.h5"), load_machine(folder / "machine.toml")
    try:
        found = publish(session, machine)
        (into / "explanation.json").write_text(json.dumps(found.to_json()), encoding="utf-8")
    except Exception:  # the benchmark counts whatever goes wrong and goes on
        return traceback.format_exc()
    return ""


def _by_command(folder: Path, into: Path, former: Path | None) -> str:
    """As a user would, of this or of a former checkout; returns what went wrong, or nothing."""
    command = [sys.executable, "-m", "schwung", "explain", str(folder / "session.h5")]
    command += ["--machine", str(folder / "machine.toml"), "--out", str(into)]
    environment = dict(os.environ)
    if former is not None:
        command.append("--no-weigh")
        environment["PYTHONPATH"] = str(former.absolute() / "src")
    try:
        made = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=_TIME_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return f"took more than {_TIME_LIMIT_S:.0f} s"
    return "" if (into / "explanation.json").exists() else f"{made.stdout}\n{made.stderr}"


def score(options: argparse.Namespace) -> None:
    """Open the labels, print and write the figures."""
    from explain_score import printed, score_all, write_scores

    if (options.out / "former").exists():
        print(f"Formerly:\n\n{printed(score_all(options.out, 'former'))}\n\nNow:\n")
    scores = score_all(options.out)
    print(printed(scores))
    write_scores(options.out, scores)


def everything(options: argparse.Namespace) -> None:
    """generate, run, score."""
    for step in (generate, run, score):
        step(options)


def control(options: argparse.Namespace) -> None:
    """The same sessions with [control] as given, without, and with wrong gains: how many names are lost."""
    from explain_score import score_all

    folder, rates = options.out, {}
    for belief in CONTROLS:
        options.out = folder if belief == "given" else _believing(folder, belief)
        run(options)
        scores = score_all(options.out)
        rates[belief] = 100 * sum(s.all_named and s.first_right for s in scores) / len(scores)
    text = [f"[control] given: {rates['given']:.1f} % all named, a right name first ({len(scores)} sessions)"]
    text += [f"{b}: {rates[b]:.1f} %, {rates[b] - rates['given']:+.1f} points" for b in CONTROLS[1:]]
    (folder / "control.txt").write_text("\n".join(text) + "\n", encoding="utf-8")
    print("\n".join(text))


def _believing(folder: Path, belief: str) -> Path:
    """A copy of the cases with another [control]: none at all, or each gain off by 1.3 to 2 either way."""
    other = folder / f"control-{belief}"
    for part in ("sessions", "sealed"):
        shutil.copytree(folder / part, other / part, dirs_exist_ok=True)
    chance = random.Random(4)
    for place in sorted((other / "sessions").iterdir()):
        file = place / "machine.toml"
        text = file.read_text(encoding="utf-8")
        if belief == "none":
            text = re.sub(r"\[control\]\n(\w.*\n?)*", "", text)
        else:
            text = re.sub(
                r"(position_gain|speed_gain|speed_integral_time) = (\S+)",
                lambda m: f"{m[1]} = {float(m[2]) * chance.uniform(1.3, 2.0) ** chance.choice((-1, 1)):.6g}",
                text,
            )
        file.write_text(text, encoding="utf-8")
    return other


def likeness(options: argparse.Namespace) -> None:
    """For every wrongly named single case: how far the truth is from its best likeness. Opens the seal."""
    from explain_score import score_all

    wishes = {label["case"]: label for label in read_labels(options.out)}
    for found in score_all(options.out):
        if found.kind != "single" or found.first_right:
            continue
        label = wishes[found.case]
        among = tuple(label["among"])
        case = draw_case(label["seed"], CaseWishes("single", label["level"], among, label["control"]))
        beyond, alike = likeness_of(case)
        print(
            f"{found.case}  {found.truth[0]} ({found.strength:.1f} floors, {beyond:.2f} beyond {alike}): "
            f"named {', '.join(found.names) or found.first}"
        )


STEPS = {
    "generate": generate, "run": run, "score": score, "all": everything, "control": control, "likeness": likeness,
}  # fmt: skip


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=STEPS)
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the sessions and, apart, their labels"
    )
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--kind", choices=KINDS, default="single")
    parser.add_argument(
        "--level", choices=("weak", "clear", "gross"), default="clear", help="how strong each is"
    )
    parser.add_argument("--effects", default="", help="names to hide, separated by commas; default: all")
    parser.add_argument("--control", choices=CONTROLS, default="given", help="[control] of the belief")
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    parser.add_argument("--through", choices=("call", "cli"), default="call", help="how `run` calls the tool")
    parser.add_argument(
        "--former",
        type=Path,
        metavar="CHECKOUT",
        help=f"`run` by tests against thresholds, as {FORMER} still had it",
    )
    parser.add_argument("--again", action="store_true", help="run what has been run, too")
    options = parser.parse_args()
    if options.former and options.step != "run":
        parser.error("--former is for run alone: the other steps take what it left")
    STEPS[options.step](options)


if __name__ == "__main__":
    main()
