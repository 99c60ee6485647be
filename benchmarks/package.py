"""The package as strangers get it: built, installed without extras and run in an empty environment; what it weighs.

    python benchmarks/package.py            # size and import time, the core and with MuJoCo; some minutes
    python benchmarks/package.py --check    # the core alone: fails where something does not work

Builds sdist and, from that, wheel (needs the package `build`), and makes virtual environments beside each other in a
temporary folder. Times are processor times, the least of several.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parent.parent
#: Commands and what has to be told, where an extra is missing: one sentence that names it.
WITHOUT = {
    "demo": "bench",
    "demo --plant two-mass": "bench",
    "bench --tcp 127.0.0.1:0": "bench",
    "optimise -m machine.toml --distance 1 --duration 0.2": "optimise",
    "serve": "web",
    "batch estimate .": "batch",
    "convert session.h5 session.mf4": "logs",
    "convert session.h5 session.parquet": "logs",
    "explain session.h5 --belief model.fmu --map model.toml": "fmi",
}
#: What the core may weigh (bytes): 60 % of an installation with MuJoCo and what compiles, as first measured (555 MB).
MOST_BYTES = 0.6 * 555e6
MOST_IMPORT_S = 0.05
MOST_HELP_S = 0.5
#: Of `schwung.estimate` and `schwung.commission`, which bring numpy, scipy, HDF5 and python-can.
MOST_AT_HAND_S = 1.5


def main() -> None:
    """Build, install, run, and print what it weighs."""
    check = "--check" in sys.argv
    with tempfile.TemporaryDirectory(prefix="schwung-package-") as folder:
        place = Path(folder)
        wheel = build(place)
        core = installed(wheel, place / "core", "")
        size = weight(core)
        print(f"core: {size / 1e6:.0f} MB; of that schwung itself {own_weight(core) / 1e6:.1f} MB")
        work(core, place)
        importing, helping, at_hand = told_times(core)
        if check:
            assert size < MOST_BYTES, f"the core weighs {size / 1e6:.0f} MB, more than {MOST_BYTES / 1e6:.0f}"
            for what, taken, most in (
                ("import schwung", importing, MOST_IMPORT_S),
                ("schwung --help", helping, MOST_HELP_S),
                ("estimate and commission at hand", at_hand, MOST_AT_HAND_S),
            ):
                assert taken < 2 * most, f"{what}: {taken:.3f} s"
            return
        largest(core)
        for extra in ("fast", "bench"):
            whole = weight(installed(wheel, place / extra, f"[{extra}]"))
            print(f"with [{extra}]: {whole / 1e6:.0f} MB; the core is {size / whole:.0%} of it")


def build(place: Path) -> Path:
    """sdist, and the wheel from it; the wheel has to be for every platform."""
    run([sys.executable, "-m", "build", "--outdir", str(place / "dist"), str(ROOT)])
    (wheel,) = (place / "dist").glob("*.whl")
    assert wheel.name.endswith("-py3-none-any.whl"), wheel.name
    (source,) = (place / "dist").glob("*.tar.gz")
    print(
        f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB; {source.name}: {source.stat().st_size / 1e6:.1f} MB"
    )
    return wheel


def installed(wheel: Path, place: Path, extra: str) -> Path:
    """A virtual environment with the wheel in it, and nothing else but pip; binaries only, nothing is compiled."""
    venv.create(place, with_pip=True)
    run([str(place / "bin" / "pip"), "install", "--quiet", "--only-binary", ":all:", f"{wheel}{extra}"])
    return place


def work(core: Path, place: Path) -> None:
    """What has to work without extras, and what has to say that it needs one."""
    schwung = str(core / "bin" / "schwung")
    for arguments in ("--help", "--version", "profile list"):
        run([schwung, *arguments.split()], place)
    # the bench is an extra, too: what it makes is made here
    run([sys.executable, "-m", "schwung", "demo", "--plant", "two-mass", "--out", "made"], place)
    estimating = [schwung, "estimate", "made/session.h5", "-m", "made/machine.toml", "--out", "estimate"]
    print(f"schwung estimate without numba: {least(estimating, 1, place):.1f} s")
    here, there = (
        [float(row.split(",")[1]) for row in (place / folder / "inertia.csv").read_text("utf-8").split()[1:]]
        for folder in ("made", "estimate")
    )
    assert all(abs(a - b) < 1e-9 * b for a, b in zip(there, here, strict=True)), (
        "without numba it says otherwise"
    )
    found = run([schwung, *["doctor", "-i", "virtual", "-c", "nobody", "-n", "1"]], place, expected=3)
    assert "Commissioning cannot start" in found.stdout, found.stdout
    for name in ("machine.toml", "session.h5"):
        (place / name).write_bytes((place / "made" / name).read_bytes())
    for name in ("model.fmu", "model.toml"):
        (place / name).touch()
    for arguments, extra in WITHOUT.items():
        refused = run([schwung, *arguments.split()], place, expected=2)
        asked = f'not installed here. Run pip install "schwung[{extra}]".'
        (told,) = refused.stderr.splitlines()  # no traceback, no second line
        assert told.endswith(asked), told
        print(f"schwung {arguments}: {refused.stderr.strip()}")


def told_times(core: Path) -> tuple[float, float, float]:
    """Processor seconds of `import schwung` beyond Python's own, of `schwung --help`, and of what they wait for."""
    python = str(core / "bin" / "python")
    plain = least([python, "-c", "pass"])
    importing = least([python, "-c", "import schwung"]) - plain
    everything = least([python, "-c", "import schwung; schwung.estimate; schwung.commission"], 3) - plain
    helping = least([str(core / "bin" / "schwung"), "--help"])
    print(f"import schwung: {importing * 1e3:.0f} ms; schwung --help: {helping * 1e3:.0f} ms; "
          f"with estimate and commission at hand: {everything * 1e3:.0f} ms")  # fmt: skip
    return importing, helping, everything


def least(command: list[str], times: int = 7, folder: Path | None = None) -> float:
    """The least processor time of a command (s)."""
    taken = []
    for _ in range(times):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run(command, folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(taken)


def weight(place: Path) -> int:
    """Bytes of everything that was installed, pip not counted."""
    return sum(
        bytes_in(folder) for folder in packages(place) if not folder.name.startswith(("pip", "setuptools"))
    )


def own_weight(place: Path) -> int:
    """Bytes of ours."""
    return sum(bytes_in(folder) for folder in packages(place) if folder.name.startswith("schwung"))


def largest(place: Path) -> None:
    """Who the weight is."""
    sizes = sorted(((bytes_in(folder), folder.name) for folder in packages(place)), reverse=True)
    print("largest: " + ", ".join(f"{name} {size / 1e6:.0f} MB" for size, name in sizes[:8]))


def packages(place: Path) -> list[Path]:
    """What lies in site-packages."""
    (site,) = place.glob("lib/python*/site-packages")
    return [folder for folder in site.iterdir() if folder.name != "__pycache__"]


def bytes_in(place: Path) -> int:
    """Of a file, or of all files in a folder but what Python has compiled."""
    if place.is_file():
        return place.stat().st_size
    return sum(file.stat().st_size for file in place.rglob("*") if file.is_file() and file.suffix != ".pyc")


def run(
    command: list[str], folder: Path | None = None, expected: int = 0
) -> subprocess.CompletedProcess[str]:
    """Run to its end; AssertionError with what it said where it ends otherwise than expected."""
    alone = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=alone, check=False)
    assert done.returncode == expected, f"{command}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done


if __name__ == "__main__":
    main()
