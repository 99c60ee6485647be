"""The parent of `player.py`: jobs in, what the FMU did out; its crash is one sentence."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array
from schwung.simulators.mapping import Ports, as_document
from schwung.simulators.player import LONGEST_JOB_S, MARK


@dataclass(frozen=True, eq=False)
class Job:
    """A motion to be followed on a grid from `begin_s` on: angles and speeds (n + 1,), torque over each step (n,).

    `gains`: N·m/rad and N·m·s/rad that keep a forward FMU near the motion; both 0: the torque alone acts.
    """

    begin_s: float
    step_s: float
    angle_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array
    gains: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Played:
    """What the FMU did: angles and speeds at the instants (n + 1,), torque over each step (n,)."""

    job: Job
    angle_rad: Array
    speed_rad_s: Array
    torque_nm: Array

    @property
    def time_s(self) -> Array:
        """The instants, (n + 1,)."""
        return np.asarray(self.job.begin_s + self.job.step_s * np.arange(self.angle_rad.size), dtype=float)


def play(
    fmu: Path, ports: Ports, jobs: Sequence[Job], progress: Callable[[float], None] | None = None
) -> tuple[Played, ...]:
    """Play an FMU in a process of its own. `progress`: told the share of the jobs that is done.

    Raises InputError where the FMU fails, crashes, does not come back, or gives what is no number.
    """
    with tempfile.TemporaryDirectory(prefix="schwung-fmu-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        request = as_document(ports) | {"fmu": str(fmu.resolve()), "jobs": len(jobs)}
        (folder / "request.json").write_text(json.dumps(request), encoding="utf-8")
        arrays = {name: values for i, job in enumerate(jobs) for name, values in _arrays(i, job).items()}
        np.savez(folder / "jobs.npz", allow_pickle=False, **arrays)
        code, said = _run(folder, len(jobs), progress)
        failure = folder / "failure.json"
        if failure.exists():
            what = " ".join(json.loads(failure.read_text(encoding="utf-8"))["what"].split())
            what = what.replace(f"{folder / 'unpacked'}/", "")
            raise InputError(
                str(fmu),
                f"failed while it was played: {what[:300].rstrip('.')}",
                _said(said) or "Try it in its own tool.",
            )
        if code != 0 or not (folder / "answer.npz").exists():
            raise InputError(str(fmu), _how(code, said), "Try it in its own tool; nothing was written.")
        with np.load(folder / "answer.npz") as answer:
            played = tuple(
                Played(job, *(answer[f"{i}/{name}"] for name in ("angle", "speed", "torque")))
                for i, job in enumerate(jobs)
            )
    for one in played:
        if not all(np.all(np.isfinite(values)) for values in (one.angle_rad, one.speed_rad_s, one.torque_nm)):
            raise InputError(str(fmu), "gives values that are no numbers", "Try it in its own tool.")
    return played


def _arrays(number: int, job: Job) -> dict[str, Array]:
    named = {
        "clock": np.array([job.begin_s, job.step_s]),
        "angle": job.angle_rad,
        "speed": job.speed_rad_s,
        "acceleration": job.acceleration_rad_s2,
        "torque": job.torque_nm,
        "gains": np.array(job.gains),
    }
    return {f"{number}/{name}": values for name, values in named.items()}


def _run(folder: Path, jobs: int, progress: Callable[[float], None] | None) -> tuple[int, str]:
    """Exit code, and what was printed (its end)."""
    said: list[str] = []
    with subprocess.Popen(
        [sys.executable, "-m", "schwung.simulators.player", str(folder)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        text=True, encoding="utf-8", errors="replace",
    ) as child:  # fmt: skip
        try:
            assert child.stdout is not None
            for line in child.stdout:
                if line.startswith(MARK):
                    if progress is not None:
                        progress(int(line.removeprefix(MARK)) / jobs)
                else:
                    said = [*said[-40:], line.rstrip()]
            code = child.wait()
        except BaseException:
            child.kill()
            raise
    return code, "\n".join(said)


def _how(code: int, said: str) -> str:
    if "Timeout (" in said:
        return f"did not come back within {LONGEST_JOB_S:g} s"
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        return f"crashed while it was played ({name})"
    return f"ended its process with code {code} while it was played"


def _said(said: str) -> str:
    """What the FMU had to say itself, one line."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    return f'It said: "{lines[-1][:200]}".' if lines else ""
