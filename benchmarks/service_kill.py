"""kill -9 of the service at random moments while it commissions: the drive stops, the store opens, nothing is lost.

    python benchmarks/service_kill.py --kills 200 --seed 1

The bench is in this process and the service in one of its own. Half of the kills come at a moment drawn evenly over the
time that the motor has torque, most others over a whole commissioning and a little beyond, one in seven right after the
service has started and put the drive back. After each:

    stops       the axis stands without torque, as the plant itself says, and was never beyond the stroke by more than
                a stop takes
    opens       the next service starts on the same folder, and its SQLite file passes an integrity check
    finished    every run that was told as done is still done, with the same result and the same bytes in its files
    restored    what the drive's parameters were before the first commissioning, they are again, as the bench has them

Prints when the kills came and how long the drive took; ends with exit code 1 and the seed where anything of that fails.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import contextlib
import random
import shutil
import sqlite3
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from service_room import ENDED, FailedError, Serving, Witness, changed_objects, require_finished

from schwung.errors import DriveError
from schwung_sim.bench import Bench

STROKE_RAD = 3.14
#: How far beyond the stroke a stop may end: the way of a quick stop from full speed, and what the loop overshoots.
BEYOND_RAD = 0.6
#: An axis that is slower stands: a two-mass machine still rings by as much, of 19 rad/s in the stroke.
STOOD_RAD_S = 0.5
PATIENCE_S = 20.0  # by the wall, on any computer; what it took is told
ATTEMPTS = 5  # at a first commissioning, where the computer is too busy for 1 kHz
QUIET_S = 2.0  # without torque for so long, the motions are over
BEYOND_END = 1.15  # of a commissioning's time: some kills come after it
DURING_START, DURING_MOTION = 1 / 7, 1 / 2


@dataclass
class Tally:
    """What was seen."""

    finished: dict[str, dict[str, Any]] = field(default_factory=dict)
    stops_s: list[float] = field(default_factory=list)
    off_at_rad_s: float = 0.0  # the fastest that the axis still was when its torque ended
    states: Counter[str] = field(default_factory=Counter)  # of the killed run, as the next service tells
    energised: int = 0  # kills that came while the motor had torque
    written: int = 0
    notes: list[str] = field(default_factory=list)


def kill_again_and_again(folder: Path, kills: int, seed: int) -> Tally:
    """Do it. Raises FailedError."""
    luck, tally, data = random.Random(seed), Tally(), folder / "data"
    with Bench("two-mass", tcp=("127.0.0.1", 0), node_id=1) as bench:
        witness = Witness(bench)
        before = dict(bench.servo.dictionary.values)
        serving = Serving(data, bench.tool_options).start()
        drive_id = serving.drive()["id"]
        took_s, torque_s = _first(serving, drive_id, witness, tally)
        for number in range(kills):
            asked, chance = None, luck.random()
            if chance < DURING_START:  # the service was just started, and has put the drive back
                after_s = luck.uniform(0.0, 1.0)
            else:
                asked = serving.post("runs", serving.propose(drive_id, **_stroke(witness)))["id"]
                if chance < DURING_START + DURING_MOTION:
                    after_s = luck.uniform(0.0, torque_s)
                    _until_motion(serving, asked, witness)
                else:
                    after_s = luck.uniform(0.0, BEYOND_END * took_s)
            time.sleep(after_s)
            tally.energised += bench.axis.energised
            serving.kill()
            tally.stops_s.append(witness.stopped_within(PATIENCE_S))
            tally.off_at_rad_s = witness.off_at_rad_s
            _require_within(witness)
            _require_sound(data)
            serving = Serving(data, bench.tool_options).start()
            if asked is not None:
                _look_after(serving, asked, tally)
            tally.written += serving.put_back(drive_id)
            require_finished(serving, tally.finished)
            _require_restored(bench, before, data)
            print(
                f"{number + 1:4d} of {kills}: after {after_s:5.2f} s, off {tally.stops_s[-1]:.3f} s later, never "
                f"above {witness.off_at_rad_s:.3f} rad/s so far; {dict(tally.states)}",
                flush=True,
            )
        code = serving.terminate()
        if code not in (0, 130):
            raise FailedError(f"the service ended with {code}: {serving.said()[-1000:]}")
    return tally


def _first(serving: Serving, drive_id: str, witness: Witness, tally: Tally) -> tuple[float, float]:
    """How long a commissioning takes, and how long its motor has torque (s, by the wall)."""
    for _ in range(ATTEMPTS):
        began = time.monotonic()
        asked = serving.post("runs", serving.propose(drive_id, **_stroke(witness)))["id"]
        torque_s = _with_torque(witness)
        run = serving.ended(asked)
        if run["state"] == "done":
            tally.finished[asked] = run
            return time.monotonic() - began, torque_s
        tally.notes.append(run["error"]["text"])
    raise FailedError(
        f"none of {ATTEMPTS} commissionings came to its end, without any kill: {tally.notes[-1]}"
    )


def _wait(ready: Callable[[], bool], every_s: float = 0.002) -> None:
    end = time.monotonic() + 60.0
    while not ready():
        if time.monotonic() > end:
            raise FailedError("the run did not come to its motion within 60 s")
        time.sleep(every_s)


def _until_motion(serving: Serving, run_id: str, witness: Witness) -> None:
    """The motor has torque, or the run has ended without."""
    # asked more often, the service would do little else
    _wait(lambda: witness.bench.axis.energised or serving.get(f"runs/{run_id}")["state"] in ENDED, 0.05)


def _with_torque(witness: Witness) -> float:
    """How long the motor has torque in a commissioning (s, by the wall), looked at while it goes on."""
    _wait(lambda: witness.bench.axis.energised)
    began = last = time.monotonic()
    while time.monotonic() - last < QUIET_S:
        if witness.bench.axis.energised:
            last = time.monotonic()
        time.sleep(0.01)
    return last - began


def _stroke(witness: Witness) -> dict[str, Any]:
    """Half a turn, away from where it is least far, so that the axis stays where it is."""
    witness.begin()
    return {"distance_rad": STROKE_RAD if witness.angle_rad < STROKE_RAD / 2 else -STROKE_RAD, "duration_s": 0.25,
            "repeats": 1}  # fmt: skip


def _look_after(serving: Serving, run_id: str, tally: Tally) -> None:
    run = serving.get(f"runs/{run_id}")
    tally.states[run["state"]] += 1
    if run["state"] == "done":
        tally.finished[run_id] = run
    elif run["state"] == "failed" and run["error"]["exit_code"] == DriveError.exit_code:
        tally.notes.append(
            run["error"]["text"]
        )  # on a busy computer an answer may have come too late: no kill's doing
    elif run["state"] not in ("interrupted", "cancelled"):
        raise FailedError(f"the killed run is {run['state']}: {run['error']}")


def _require_within(witness: Witness) -> None:
    travel = witness.highest_rad - witness.lowest_rad
    if travel > STROKE_RAD + BEYOND_RAD:
        raise FailedError(f"the axis has travelled {travel:.3f} rad of a stroke of {STROKE_RAD:g} rad")
    if witness.off_at_rad_s > STOOD_RAD_S:
        raise FailedError(f"the torque ended at {witness.off_at_rad_s:.2f} rad/s: that is no stop, it coasts")


def _require_sound(data: Path) -> None:
    """SQLite's own opinion of a copy, as it was left: the service itself has to open it as it lies."""
    with tempfile.TemporaryDirectory() as temporary:
        for file in data.glob("schwung.db*"):
            shutil.copy(file, temporary)
        with contextlib.closing(sqlite3.connect(Path(temporary) / "schwung.db")) as store:
            found = store.execute("PRAGMA integrity_check").fetchone()[0]
    if found != "ok":
        raise FailedError(f"the store is broken: {found}")


def _require_restored(bench: Bench, before: dict[int, Any], data: Path) -> None:
    now = bench.servo.dictionary.values
    off = {
        key: (before.get(key), now.get(key))
        for key in changed_objects(data)
        if before.get(key) != now.get(key)
    }
    if off:
        words = ", ".join(f"0x{k >> 8:04X}:{k & 0xFF:02X} {a} → {b}" for k, (a, b) in list(off.items())[:5])
        raise FailedError(f"not put back: {words}")


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="keeps store and log; default: a temporary one")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        began = time.monotonic()
        try:
            tally = kill_again_and_again(folder, given.kills, given.seed)
        except FailedError as failure:
            sys.exit(f"seed {given.seed}: {failure}")
    stops = sorted(tally.stops_s)
    print(
        f"{given.kills} kills in {time.monotonic() - began:.0f} s, {tally.energised} of them while the motor had torque"
    )
    print(
        f"the drive always stopped: {stops[len(stops) // 2]:.3f} s in the median, {stops[-1]:.3f} s at most (wall)"
    )
    print(f"the axis was never faster than {tally.off_at_rad_s:.3f} rad/s when its torque ended")
    print(f"the killed runs: {dict(tally.states)}; {len(tally.finished)} runs finished, none lost")
    for note in tally.notes:
        print(f"failed before it was killed: {note}")
    print(f"{tally.written} parameters put back; the store was sound each time")


if __name__ == "__main__":
    main()
