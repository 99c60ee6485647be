"""What Prometheus reads at /metrics: buses, samples, SYNC, runs, STOP. Read when it is asked for; nothing is polled.

    schwung_bus_load_percent{drive}          of the bus's own time since the last reading, a second ago at least
    schwung_bus_frames_total{drive,way}      way: sent, received
    schwung_samples_total{drive}             rows of recordings; schwung_samples_lost_total: of them, lost ones
    schwung_sync_jitter_seconds{drive}       histogram: how far each interval of SYNC was off its mean
    schwung_runs{state}                      runs of the store by state
    schwung_stop_latency_seconds             histogram: from STOP to the driver's word that it has sent it
    schwung_drive_connected{drive}           1 or 0

Counts of a drive begin at 0 when it is connected, which Prometheus knows how to read. On Modbus there is no SYNC and no
frame: its drives have neither.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from prometheus_client import CollectorRegistry, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from schwung.api.drives import Drive
from schwung.api.watching import JITTER_EDGES_S, Counted, Traffic

#: Upper edges of the classes of STOP's latency (s); what is asked for is 0.1 s at the 99th percentile.
_STOP_EDGES_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
_SHORTEST_S = 1.0  # between two readings of a load

#: Ids and drives that are connected, by the name of each.
Drives = Callable[[], Iterable[tuple[str, Drive]]]


@dataclass
class _Seen:
    traffic: Traffic
    at_s: float  # by the bus's clock: a simulated one has its own
    bits: int
    percent: float = 0.0


class Meters:
    """All numbers of one service. `runs` counts the store's runs by state."""

    def __init__(self, drives: Drives, runs: Callable[[], Mapping[str, int]]) -> None:
        self._registry = CollectorRegistry()
        self._stop = Histogram(
            "schwung_stop_latency_seconds",
            "From STOP until the driver has sent it",
            buckets=_STOP_EDGES_S,
            registry=self._registry,
        )
        self._registry.register(_Readings(drives, runs))

    def stopped(self, latency_s: float) -> None:
        """A drive was halted so long after STOP; from any thread."""
        self._stop.observe(latency_s)

    def text(self) -> bytes:
        """All of them in Prometheus' text format 0.0.4."""
        return bytes(generate_latest(self._registry))


class _Readings(Collector):
    """What is read at the moment of asking."""

    def __init__(self, drives: Drives, runs: Callable[[], Mapping[str, int]]) -> None:
        self._drives, self._runs = drives, runs
        self._seen: dict[str, _Seen] = {}
        self._lock = threading.Lock()

    def describe(self) -> Iterable[Metric]:
        """Nothing that would need a drive to be asked."""
        return ()

    def collect(self) -> Iterator[Metric]:
        """See prometheus_client.registry.Collector."""
        runs = GaugeMetricFamily("schwung_runs", "Runs by state", labels=["state"])
        for state, number in sorted(self._runs().items()):
            runs.add_metric([state], number)
        yield runs
        load = GaugeMetricFamily("schwung_bus_load_percent", "Share of the bus time", labels=["drive"])
        frames = CounterMetricFamily("schwung_bus_frames", "Frames on the bus", labels=["drive", "way"])
        samples = CounterMetricFamily("schwung_samples", "Rows of recordings", labels=["drive"])
        lost = CounterMetricFamily("schwung_samples_lost", "Rows that lost something", labels=["drive"])
        jitter = HistogramMetricFamily(
            "schwung_sync_jitter_seconds", "Intervals of SYNC off their mean", labels=["drive"]
        )
        for name, drive in self._drives():
            if not isinstance(drive, Counted):
                continue
            traffic = drive.traffic
            load.add_metric([name], self._load(name, traffic, drive.clock.now()))
            frames.add_metric([name, "sent"], traffic.sent)
            frames.add_metric([name, "received"], traffic.received)
            samples.add_metric([name], traffic.samples)
            lost.add_metric([name], traffic.lost)
            jitter.add_metric([name], _buckets(traffic.jitter), traffic.jitter_sum_s)
        yield from (load, frames, samples, lost, jitter)

    def _load(self, name: str, traffic: Traffic, now_s: float) -> float:
        with self._lock:
            seen = self._seen.get(name)
            if seen is None or seen.traffic is not traffic:
                seen = self._seen[name] = _Seen(traffic, now_s, traffic.bits)
            elif now_s - seen.at_s >= _SHORTEST_S:
                took_s, bits = now_s - seen.at_s, traffic.bits
                seen.percent = 100 * (bits - seen.bits) / (took_s * traffic.bits_per_s)
                seen.at_s, seen.bits = now_s, bits
            return seen.percent


def _buckets(counts: Iterable[int]) -> list[tuple[str, float]]:
    """Prometheus' classes are cumulative."""
    edges, total, found = [*map(str, JITTER_EDGES_S), "+Inf"], 0, []
    for edge, count in zip(edges, counts, strict=True):
        total += count
        found.append((edge, float(total)))
    return found
