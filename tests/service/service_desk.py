"""A service with a bench on a stepped clock: real drivers, real procedure, no waiting."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

from fastapi.testclient import TestClient

from schwung.cli.demo import BELIEF
from schwung.fieldbus.canopen import BusOptions
from schwung.service.app import make_app
from schwung.service.guard import Guard, own_token
from schwung.service.service import Service
from schwung.service.values import ENDED, BusEntry, DriveSeed, RunView, Settings
from schwung.service.work.computing import estimate_session
from schwung.service.workshop import Compute, Tell, Workshop
from schwung_sim.bench import Bench

_channels = count()
STROKE = {"distance_rad": 3.14, "duration_s": 0.25, "repeats": 1, "sample_rate_hz": 500.0}
ADDRESS = "http://127.0.0.1:8737"


def settings_for(folder: Path, channel: str = "", log: Path | None = None, **more: Any) -> Settings:
    """Settings with one stepped bus and a drive on it, or without any bus; `log`: of all its frames."""
    buses = (BusEntry("bench", BusOptions("stepped", channel, 1_000_000, log=log)),) if channel else ()
    drives = (
        (DriveSeed("Bench axis", "bench", 1, "schwung-bench", BELIEF, "Slider-crank"),) if channel else ()
    )
    return Settings(**{"folder": folder, "buses": buses, "drives": drives, "poll_s": 0.0, **more})


@dataclass
class ServiceDesk:
    """The service, its bench, and somebody who asks."""

    service: Service
    guard: Guard
    bench: Bench

    @property
    def drive_id(self) -> str:
        return self.service.store.drives()[0].id

    def ask(self, kind: str, who: str = "tester", **request: Any) -> RunView:
        """Ask for a run and wait for its end."""
        return self.ended(self.service.submit({"kind": kind, **request}, who).id)

    def ended(self, run_id: str, within_s: float = 110.0) -> RunView:
        """The run, when it has ended."""
        end = time.monotonic() + within_s
        while (run := self.service.run(run_id)).state not in ENDED:
            assert time.monotonic() < end, run
            time.sleep(0.02)
        return run

    def phase(self, run_id: str) -> str:
        """What the run is at; nothing where it has ended."""
        progress = self.service.run(run_id).progress
        return "" if progress is None else progress.phase

    def proposed(self, **more: Any) -> Mapping[str, Any]:
        """The result of a plan that can start."""
        run = self.ask("plan", drive_id=self.drive_id, **{**STROKE, **more})
        assert run.state == "done", run.error
        assert run.result is not None
        return run.result

    def confirmed(self, kind: str = "commission", **more: Any) -> RunView:
        """Plan and carry out; returns the run as submitted."""
        made = self.proposed(**more)
        request = {"kind": kind, "proposal_id": made["proposal_id"], "digest": made["digest"]}
        return self.service.submit(request, "tester")

    def client(self, token: bool = True) -> TestClient:
        """Who speaks HTTP to it."""
        headers = {"Authorization": f"Bearer {self.guard.token}"} if token else {}
        app = make_app(self.service, self.guard)
        return TestClient(app, base_url=ADDRESS, headers=headers, raise_server_exceptions=False)


def _compute_here(
    _: Workshop, function: Compute, arguments: Mapping[str, Any], tell: Tell, cancelled: object, **_more: bool
) -> dict[str, Any]:
    if function is estimate_session:
        return {"verdict": "good", "document": {}}
    return function(**arguments, tell=tell)


@contextmanager
def nothing_estimated() -> Iterator[None]:
    """Within: commissionings are recorded and kept, and what comes of them is nobody's matter: most of their time."""
    with patch.object(Workshop, "run", _compute_here), patch.object(Workshop, "warm", lambda _: None):
        yield


@contextmanager
def service_desk(
    folder: Path, plant: str = "two-mass", log: Path | None = None, **bench: Any
) -> Iterator[ServiceDesk]:
    """A running service with its bench; both end with the block."""
    channel = f"service-{next(_channels)}"
    with Bench(plant, channel=channel, node_id=1, **bench) as machine_room:
        settings = settings_for(folder, channel, log)
        with Service(settings) as service:
            yield ServiceDesk(service, Guard(settings, own_token(folder)), machine_room)
