"""The sealed benchmark of `schwung explain`: random machines hide physics, and nobody but the score knows which.

    python benchmarks/explain.py generate --out DIR --cases 24 --kind single
    python benchmarks/explain.py run      --out DIR
    python benchmarks/explain.py score    --out DIR
    python benchmarks/explain.py all      --out DIR --cases 24 --kind single

`generate` draws machines in the virtual machine room, which shares no code with the tool, and writes
DIR/sessions/NNNN/ (session.h5, machine.toml, inertia.csv) and, apart, DIR/sealed/labels.jsonl. Only `score` opens that.
"""

from __future__ import annotations

import argparse
import shutil
import time
from pathlib import Path

from schwung_sim.sealed import LABELS, CaseWishes, draw_case, write_case

KINDS = ("single", "weak", "gross", "two", "three", "none", "foreign")


def wishes_of(options: argparse.Namespace) -> CaseWishes:
    """The kind of the command line as the generator takes it: weak and gross are single effects."""
    level = options.kind if options.kind in ("weak", "gross") else options.level
    kind = "single" if options.kind in ("weak", "gross") else options.kind
    among = tuple(options.effects.split(",")) if options.effects else ()
    return CaseWishes(kind, level, among, options.control)


def generate(options: argparse.Namespace) -> None:
    """Draw, record and write the cases; what the folder held before is replaced."""
    if (options.out / LABELS).exists():
        shutil.rmtree(options.out / "sessions")
        (options.out / LABELS).unlink()
    wishes = wishes_of(options)
    began = time.perf_counter()
    for number in range(options.cases):
        write_case(draw_case(options.first + number, wishes), options.out, f"{number:04d}")
    taken = time.perf_counter() - began
    print(
        f"{options.cases} sessions in {options.out / 'sessions'}, {taken / options.cases:.1f} s each; labels sealed"
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("step", choices=("generate",))
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the sessions and, apart, their labels"
    )
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--kind", choices=KINDS, default="single")
    parser.add_argument(
        "--level", choices=("weak", "clear", "gross"), default="clear", help="how strong, for single"
    )
    parser.add_argument("--effects", default="", help="names to hide, separated by commas; default: all")
    parser.add_argument(
        "--control", choices=("given", "none", "wrong"), default="given", help="[control] of the belief"
    )
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    options = parser.parse_args()
    {"generate": generate}[options.step](options)


if __name__ == "__main__":
    main()
