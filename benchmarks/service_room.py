"""A service in a process of its own before a bench in this one, spoken to as anybody speaks to it: over HTTP."""

from __future__ import annotations

import atexit
import hashlib
import json
import select
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from schwung.cli.demo import BELIEF
from schwung_sim.bench import Bench
from schwung_sim.drives.eds import key

ENDED = ("done", "failed", "cancelled", "interrupted")
STARTED_WITHIN_S = 90.0
_START = "import sys; from schwung.cli import main; main(sys.argv[1:])"


class FailedError(Exception):
    """Something that must not be."""


@dataclass
class Witness:
    """What the bench's axis did, seen from the inside after every step of its clock; nothing of what the tool says."""

    bench: Bench
    lowest_rad: float = float("inf")
    highest_rad: float = float("-inf")
    off_at_rad_s: float = 0.0  # the fastest that the axis still was when its torque ended
    _was: bool = False

    def __post_init__(self) -> None:
        self._state = self.bench.plant.state
        self.bench.servo.on_advance = self.look

    def look(self) -> None:
        """Time has passed."""
        angle = self.angle_rad
        self.lowest_rad, self.highest_rad = min(self.lowest_rad, angle), max(self.highest_rad, angle)
        now = self.bench.axis.energised
        if self._was and not now:
            self.off_at_rad_s = max(self.off_at_rad_s, abs(float(self._state["motor_rad_s"][0])))
        self._was = now

    @property
    def angle_rad(self) -> float:
        """Where the motor is."""
        return float(self._state["motor_rad"][0])

    def begin(self) -> None:
        """From now on lowest and highest angle are counted."""
        self.lowest_rad = self.highest_rad = self.angle_rad

    @property
    def stopped(self) -> bool:
        """The motor has no torque. Without SYNC the bench's time stands still then: see `off_at_rad_s`."""
        return not self.bench.axis.energised

    def stopped_within(self, patience_s: float) -> float:
        """How long the drive still took (s, by the wall). Raises FailedError where it did not stop."""
        began = time.monotonic()
        while not self.stopped:
            if time.monotonic() > began + patience_s:
                state = self.bench.servo.power.state.name
                raise FailedError(f"after {patience_s:g} s the drive is in {state} and its motor has torque")
            time.sleep(0.002)
        return time.monotonic() - began


@dataclass
class Serving:
    """One process of the service, killed or ended by who started it."""

    folder: Path
    bus: Mapping[str, Any]
    more: Sequence[str] = ()
    told: dict[str, Any] = field(default_factory=dict)

    def start(self) -> Serving:
        """Start it and wait until it tells where it is. Raises FailedError with what it said where it does not."""
        extra = [
            f"--bus={name}={value}"
            for name, value in self.bus.items()
            if name not in ("interface", "channel")
        ]
        command = ["serve", "--data", str(self.folder), "--port", "0", "--json",
                   "-i", self.bus["interface"], "-c", self.bus["channel"], "-b", "1000000",
                   *extra, *self.more]  # fmt: skip
        self._log = (self.folder.parent / "service.log").open("ab")
        self.process = subprocess.Popen(
            [sys.executable, "-c", _START, *command], stdout=subprocess.PIPE, stderr=self._log
        )
        atexit.register(self.process.kill)  # nothing is left behind where the benchmark fails
        self.told = self._announced()
        headers = {"Authorization": f"Bearer {self.told['token']}", "Schwung-Who": "benchmark"}
        self.client = httpx.Client(base_url=self.told["url"], headers=headers, timeout=30.0)
        return self

    def _announced(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        end, text = time.monotonic() + STARTED_WITHIN_S, b""
        while time.monotonic() < end:
            if select.select([self.process.stdout], [], [], 0.1)[0]:
                came = self.process.stdout.read1(65536)
                text += came
                if not came:
                    break
                try:
                    told: dict[str, Any] = json.loads(text)
                except ValueError:
                    continue
                if "token" in told:
                    return told
                break
        self.process.kill()
        said = text.decode(errors="replace") + self.said()[-2000:]
        raise FailedError(f"the service did not start: {said}")

    def said(self) -> str:
        """What it printed on stderr, all processes of this folder."""
        return (self.folder.parent / "service.log").read_text(errors="replace")

    def kill(self) -> None:
        """kill -9."""
        self.process.kill()
        self._gone()

    def terminate(self) -> int:
        """SIGTERM, and its exit code."""
        self.process.terminate()
        self._gone()
        return int(self.process.returncode)

    def _gone(self) -> None:
        self.client.close()
        self.process.wait(60)
        assert self.process.stdout is not None
        self.process.stdout.close()
        self._log.close()

    def get(self, path: str, **query: Any) -> Any:
        """What is at a path. Raises FailedError where that is refused."""
        return self._checked(self.client.get(f"/api/{path}", params=query))

    def post(self, path: str, body: Mapping[str, Any] | None = None) -> Any:
        """What comes of asking. Raises FailedError where it is refused."""
        return self._checked(self.client.post(f"/api/{path}", json=body))

    @staticmethod
    def _checked(response: httpx.Response) -> Any:
        if response.status_code >= 300:
            raise FailedError(f"{response.request.method} {response.request.url.path}: {response.text[:600]}")
        return response.json()

    def ended(self, run_id: str, within_s: float = 120.0) -> dict[str, Any]:
        """A run, when it has ended."""
        end = time.monotonic() + within_s
        while (run := self.get(f"runs/{run_id}"))["state"] not in ENDED:
            if time.monotonic() > end:
                raise FailedError(f"run {run_id} has not ended within {within_s:g} s: {run}")
            time.sleep(0.05)
        return dict(run)

    def done(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Ask for a run and wait for its result. Raises FailedError where it has none."""
        run = self.ended(self.post("runs", request)["id"])
        if run["state"] != "done":
            raise FailedError(f"{request['kind']}: {run['state']}, {run['error']}")
        return run

    def drive(self) -> dict[str, Any]:
        """Our drive, added with its machine where the store has none yet."""
        drives = self.get("drives")
        if not drives:
            machine = self.post("machines", {"name": "belief", "toml": BELIEF})
            added = {
                "name": "axis",
                "bus": "bus",
                "node_id": 1,
                "profile": "schwung-bench",
                "machine_id": machine["id"],
            }
            drives = [self.post("drives", added)]
        return dict(drives[0])

    def propose(self, drive_id: str, **stroke: Any) -> dict[str, Any]:
        """The confirmed request of a commissioning, planned and proposed."""
        made = self.done({"kind": "plan", "drive_id": drive_id, **stroke})["result"]
        return {"kind": "commission", "proposal_id": made["proposal_id"], "digest": made["digest"]}

    def put_back(self, drive_id: str) -> int:
        """Restore what interrupted runs have left in the drive; returns how many parameters were written."""
        written = 0
        for unsafe in self.get(f"drives/{drive_id}")["unsafe"]:
            made = self.done({"kind": "propose_restore", "drive_id": drive_id, "unsafe_id": unsafe["id"]})[
                "result"
            ]
            request = {"kind": "restore", "proposal_id": made["proposal_id"], "digest": made["digest"]}
            written += len(self.done(request)["result"]["changes"])
        return written


def changed_objects(folder: Path) -> set[int]:
    """Keys of all objects that any backup below a folder names."""
    found: set[int] = set()
    for path in folder.rglob("*.backup.json"):
        for change in json.loads(path.read_text())["changes"]:
            found.add(key(int(change["index"], 16), change["subindex"]))
    return found


def require_finished(serving: Serving, finished: Mapping[str, dict[str, Any]]) -> None:
    """Raise FailedError where a run that was told as done is not, or its files are not what they were."""
    for run_id, was in finished.items():
        now = serving.get(f"runs/{run_id}")
        if now["state"] != "done" or now["result"] != was["result"]:
            raise FailedError(f"run {run_id} was done, and is {now['state']}")
        for file in serving.get(f"runs/{run_id}/files"):
            content = serving.client.get(f"/api/files/{file['id']}").content
            if hashlib.sha256(content).hexdigest() != file["sha256"]:
                raise FailedError(f"file {file['name']} of run {run_id} is not what it was")
