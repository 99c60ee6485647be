"""What Prometheus is told, held against the wire: a third end of the bus counts for itself, and does the mischief."""

from __future__ import annotations

import errno
import time
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can
import pytest
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families
from service_desk import ServiceDesk, nothing_estimated, service_desk

from schwung.clock import SteppedBus
from schwung.session import read_session
from schwung_sim.bench import Bench

AXIS = "Bench axis"
SYNC, TPDOS = 0x80, (0x181, 0x281)
BIT_RATE = 1_000_000
EDGES_S = (10e-6, 20e-6, 50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, 10e-3)
FAST_RAD_S = 5.0  # no creep and no standstill: a stroke, which is recorded


def wire_bits(message: can.Message) -> int:
    """Of a frame with the most stuff bits that it can have: 55 without data, 135 with 8 bytes (ISO 11898-1)."""
    return 55 + 10 * len(message.data)


@dataclass
class Wire:
    """Everything on the wire, seen by its weather; of the tool's SYNCs, when each was sent."""

    bench: Bench
    tool: Any = None  # the tool's end, once it has sent
    sent: int = 0  # by the tool
    delivered: int = 0  # to the tool
    bits: int = 0
    sync_s: list[float] = field(default_factory=list)
    lost: int = 0  # answers to SYNC that were kept from the tool
    lose: Callable[[int, int], bool] = lambda _sync, _can_id: False

    def __post_init__(self) -> None:
        self.clock = self.bench.bus.clock  # type: ignore[attr-defined]
        self.bench.bus.wire.weather = self  # type: ignore[attr-defined]

    def __call__(self, sender: Any, end: Any, message: can.Message) -> tuple[float, ...]:
        if sender is not self.bench.bus:
            self.tool = sender
            self.sent += 1
            self.bits += wire_bits(message)
            if message.arbitration_id == SYNC:
                self.sync_s.append(self.clock.now())
            return (0.0,)
        if message.arbitration_id in TPDOS and self.lose(len(self.sync_s), message.arbitration_id):
            self.lost += 1
            return ()
        self.delivered += 1
        self.bits += wire_bits(message)
        return (0.0,)

    @property
    def fast(self) -> bool:
        """The axis is in the middle of a stroke."""
        return abs(float(self.bench.plant.state["motor_rad_s"][0])) > FAST_RAD_S


def read(client: TestClient) -> dict[tuple[str, ...], float]:
    """All samples by their names and labels."""
    text = client.get("/metrics").text
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def commissioned(desk: ServiceDesk) -> None:
    run = desk.ended(desk.confirmed(sample_rate_hz=1000.0).id)
    assert run.state == "done", run.error


def test_frames_load_samples_and_runs_are_those_of_the_bench(tmp_path: Path) -> None:
    with nothing_estimated(), service_desk(tmp_path) as desk, desk.client(token=False) as client:
        wire = Wire(desk.bench)
        assert not [
            name for name, *_ in read(client) if name.startswith("schwung_bus")
        ]  # nobody is connected
        desk.proposed()
        before, bits, began_s = read(client), wire.bits, wire.clock.now()
        sent, delivered = wire.sent, wire.delivered
        commissioned(desk)
        after = read(client)

        def grown(name: str, *labels: str) -> float:
            return after[name, AXIS, *labels] - before[name, AXIS, *labels]

        assert grown("schwung_bus_frames_total", "sent") == wire.sent - sent > 5000
        assert grown("schwung_bus_frames_total", "received") == wire.delivered - delivered > 5000
        took_s = wire.clock.now() - began_s
        assert after["schwung_bus_load_percent", AXIS] == pytest.approx(
            100 * (wire.bits - bits) / (took_s * BIT_RATE)
        )
        rows = sum(len(run) for run in _recorded(desk))
        assert after["schwung_samples_total", AXIS] >= rows > 1000  # the creep is recorded, too
        assert after["schwung_samples_lost_total", AXIS] == wire.lost == 0
        assert (
            desk.ask(
                "plan", drive_id=desk.drive_id, distance_rad=3.14, duration_s=1.0, profile_kind="none"
            ).state
            == "failed"
        )
        assert {key: value for key, value in read(client).items() if key[0] == "schwung_runs"} == {
            ("schwung_runs", "done"): 3, ("schwung_runs", "failed"): 1,
        }  # fmt: skip


def test_a_lost_sample_counts_once_and_a_late_sync_in_its_class(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twice an answer is lost, once both of one SYNC; thrice a full send buffer holds SYNC up for 0.5 ms."""
    with nothing_estimated(), service_desk(tmp_path) as desk, desk.client(token=False) as client:
        wire = Wire(desk.bench)
        desk.proposed()
        chosen: dict[int, tuple[int, ...]] = {}  # number of a SYNC, and whose answers to it are lost
        held: list[float] = []
        plans = [(TPDOS[0],), (TPDOS[1],), TPDOS]

        def lose(sync: int, can_id: int) -> bool:
            if wire.fast and plans and sync > max(chosen, default=0) + 20 and can_id == TPDOS[0]:
                chosen[sync] = plans.pop(0)
            return can_id in chosen.get(sync, ())

        wire.lose = lose
        whole = SteppedBus.send

        def send(self: SteppedBus, message: can.Message, timeout: float | None = None) -> None:
            rpdo = self is wire.tool and message.arbitration_id == 0x201
            if rpdo and wire.fast and len(held) < 3 and wire.clock.now() > max(held, default=0.0) + 0.3:
                held.append(wire.clock.now())
                raise can.CanOperationError("no buffer space", errno.ENOBUFS)
            whole(self, message, timeout)

        monkeypatch.setattr(SteppedBus, "send", send)
        commissioned(desk)
        found = read(client)
        assert (wire.lost, len(held)) == (4, 3)
        assert found["schwung_samples_lost_total", AXIS] == 3
        count = found["schwung_sync_jitter_seconds_count", AXIS]
        off = [
            abs(later - sooner - 1e-3) for sooner, later in zip(wire.sync_s, wire.sync_s[1:], strict=False)
        ]
        late = sum(1 for one in off if 100e-6 < one < 0.9e-3)
        assert late >= len(held)  # the interval before, and the one after where the beat is kept
        below = found["schwung_sync_jitter_seconds_bucket", AXIS, "0.0002"]
        assert count - below == late
        assert (
            found["schwung_sync_jitter_seconds_bucket", AXIS, str(EDGES_S[bisect_left(EDGES_S, 0.51e-3)])]
            == count
        )
        # off the mean of its motion, which a late one moves: all others together are off by as much again
        assert 0.5e-3 * late < found["schwung_sync_jitter_seconds_sum", AXIS] < 1.1e-3 * late


def test_a_stop_is_timed(tmp_path: Path) -> None:
    with service_desk(tmp_path) as desk, desk.client(token=False) as client:
        desk.proposed()
        client.post("/api/stop")
        end = time.monotonic() + 5
        while not read(client)["schwung_stop_latency_seconds_count",]:
            assert time.monotonic() < end
            time.sleep(0.01)


def _recorded(desk: ServiceDesk) -> Any:
    (run,) = desk.service.store.runs(kind="commission")
    return read_session(desk.service.store.run_folder(run.id) / "session.h5").runs
