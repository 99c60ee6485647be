"""A commissioning that somebody logged on the bus becomes the session that it was, by the EDS alone."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np
import pytest
from bench_machine import Desk, desk
from bench_process import schwung

from schwung.clock import SteppedBus
from schwung.commissioning import Commissioned
from schwung.errors import InputError
from schwung.estimation import estimate
from schwung.estimation.denoise import same_motion
from schwung.fieldbus.canlog import LogRecipe, import_can_log
from schwung.fieldbus.profile import load_profile
from schwung.session import Session
from schwung.session.imports import Imported
from schwung.session.imports.canframes import read_frames

EDS = load_profile("schwung-bench").folder / "schwung-bench.eds"


@dataclass(frozen=True)
class Logged:
    """A commissioning, and what `candump -L` would have written of it."""

    done: Commissioned
    log: Path

    def lines(self) -> list[str]:
        return self.log.read_text().splitlines()

    def messages(self) -> list[can.Message]:
        with can.CanutilsLogReader(self.log) as reader:
            return list(reader)


@contextmanager
def logging(room: Desk, path: Path) -> Iterator[None]:
    """Everything on the desk's bus into a file, as `candump -L` writes it."""
    tap = SteppedBus(room.bench.channel)
    with can.CanutilsLogWriter(path, channel="can0") as writer:
        task = tap.clock.read(tap, writer.on_message_received, lambda error: None)
        yield
        task.close()
    tap.shutdown()


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Logged:
    folder = tmp_path_factory.mktemp("logged")
    with desk(seed=11) as room, logging(room, folder / "candump.log"):
        # no whole number of samples in a period, so that its counts are not rounded alike in each
        done = room.commission(folder / "out", repeats=2, sample_rate_hz=500.0, frequency_hz=47.0)
    return Logged(done, folder / "candump.log")


def imported(path: Path, **said: object) -> Imported:
    return import_can_log(path, LogRecipe(EDS, **said))  # type: ignore[arg-type]  # by name


@pytest.fixture(scope="module")
def whole(logged: Logged) -> Session:
    """What is made of the log as it is."""
    return imported(logged.log).session


def test_the_log_gives_the_same_runs_and_the_same_table(logged: Logged, whole: Session) -> None:
    found = whole
    own = logged.done.session
    assert [(run.role, run.repeat) for run in found.runs] == [(run.role, run.repeat) for run in own.runs]
    for run, ours in zip(found.runs, own.runs, strict=True):
        for name, values in run.datasets().items():
            np.testing.assert_allclose(values, ours.datasets()[name][: values.size], rtol=1e-12, atol=1e-12)
        assert run.motion is not None
        assert run.motion.kind == ours.motion.kind  # type: ignore[union-attr]
        assert len(run) > 0.95 * len(ours)
    sine, ours_sine = found.excited[0].excitation, own.excited[0].excitation
    assert sine is not None
    assert ours_sine is not None
    time = found.excited[0].time_s
    # the counts were rounded once; 800 samples of them tell the sine to a fraction of a count
    np.testing.assert_allclose(sine.torque(time), ours_sine.torque(time), atol=0.2 * 0.07)
    again = estimate(found, logged.done.prepared.machine).table
    table = logged.done.estimate.table
    assert table.std_kgm2 is not None
    off = again.at(table.position_rad[2:-2]) - table.inertia_kgm2[2:-2]
    assert np.sqrt(np.mean(off**2)) < np.median(table.std_kgm2)


@pytest.mark.parametrize("wishes", [{"phases": 4}, {"mode": "pp"}, {"returns": False}], ids=str)
def test_other_ways_to_commission_are_recognised(tmp_path: Path, wishes: dict[str, object]) -> None:
    """Four phases close behind each other; strokes on the drive's own profile; one way, with a way home between."""
    with desk(seed=5) as room, logging(room, tmp_path / "x.log"):
        own = room.record(tmp_path / "out", sample_rate_hz=500.0, **wishes)
    found = imported(tmp_path / "x.log").session
    injected = [run.excitation.phase_rad for run in found.excited if run.excitation]
    wanted = [run.excitation.phase_rad for run in own.excited if run.excitation]
    np.testing.assert_allclose(np.exp(1j * np.array(injected)), np.exp(1j * np.array(wanted)), atol=1e-3)
    for run, ours in zip(found.excited, own.excited, strict=True):
        later = int(
            np.argmin(
                [np.sum((ours.position_rad[k : k + 150] - run.position_rad[:150]) ** 2) for k in range(9)]
            )
        )
        size = min(len(run), len(ours) - later)
        np.testing.assert_allclose(
            run.position_rad[:size], ours.position_rad[later : later + size], atol=1e-12
        )
        assert size > 0.9 * len(ours)
        alike = [other for other in found.references if len(other) == len(run) and same_motion(other, run)]
        assert len(alike) == 1  # what is subtracted
        assert (run.position_demand_rad is None) == (wishes.get("mode") == "pp")


@pytest.mark.parametrize("suffix", ["blf", "asc", "trc"])
def test_every_log_format_gives_the_same_session(
    logged: Logged, whole: Session, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"log.{suffix}"
    with can.Logger(path) as writer:
        for message in logged.messages():
            message.channel = 1  # ASC and TRC have numbers
            writer.on_message_received(message)
    first, other = whole, imported(path).session
    assert len(other.runs) == len(first.runs)
    for run, same in zip(first.runs, other.runs, strict=True):
        np.testing.assert_array_equal(run.position_rad, same.position_rad)
        assert run.sample_rate_hz == same.sample_rate_hz


def test_frames_in_an_mdf_give_the_same_session(logged: Logged, whole: Session, tmp_path: Path) -> None:
    """As ASAM's bus logging has them."""
    asammdf = pytest.importorskip("asammdf")
    kind = [
        ("BusChannel", "u1"),
        ("ID", "<u4"),
        ("IDE", "u1"),
        ("DLC", "u1"),
        ("DataLength", "u1"),
        ("DataBytes", "(8,)u1"),
    ]
    messages = [m for m in logged.messages() if not m.is_remote_frame]
    frames = np.zeros(len(messages), dtype=[(f"CAN_DataFrame.{name}", each) for name, each in kind])
    for k, message in enumerate(messages):
        size = len(message.data)
        padded = list(message.data) + [0] * (8 - size)
        frames[k] = (1, message.arbitration_id, message.is_extended_id, size, size, padded)
    stamps = np.array([message.timestamp for message in messages])
    path = tmp_path / "bus.mf4"
    with asammdf.MDF(version="4.10") as file:
        file.append(asammdf.Signal(frames, stamps - stamps[0], name="CAN_DataFrame"))
        file.save(path)
    first, other = whole, imported(path).session
    for run, same in zip(first.runs, other.runs, strict=True):
        np.testing.assert_array_equal(run.position_rad, same.position_rad)


def test_candump_as_it_prints_and_gzipped(logged: Logged, whole: Session, tmp_path: Path) -> None:
    path = tmp_path / "printed.txt.gz"
    with gzip.open(path, "wt") as file:
        for line in logged.lines():
            stamp, _, frame, *_ = line.split()
            name, data = frame.split("#")
            pairs = " ".join(data[k : k + 2] for k in range(0, len(data), 2))
            file.write(f" {stamp}  can0  {name}   [{len(data) // 2}]  {pairs}\n")
    assert len(imported(path).session.runs) == len(whole.runs)


def test_stamps_may_be_dates_or_steps_and_a_clock_may_be_set(logged: Logged, tmp_path: Path) -> None:
    """candump -t A, -t z and -t d; and a computer whose clock was set amid the log."""
    frames = [line.split(" ", 1) for line in logged.lines()]
    stamps = np.array([float(stamp.strip("()")) for stamp, _ in frames])
    some = stamps[:2000]
    dates = [str(stamp).replace("T", " ") for stamp in (some * 1e6).round().astype("datetime64[us]")]
    frames_of = [frame for _, frame in frames]

    def rewritten(stamped: list[str]) -> Path:
        path = tmp_path / "stamped.log"
        path.write_text(
            "".join(f"({stamp}) {frame}\n" for stamp, frame in zip(stamped, frames_of, strict=False))
        )
        return path

    for stamped in (
        [f"{stamp:.6f}" for stamp in some - some[0]],
        [f"{step:.6f}" for step in np.diff(some, prepend=some[0])],
        dates,
    ):
        np.testing.assert_allclose(np.diff(read_frames(rewritten(stamped)).time_s), np.diff(some), atol=2e-6)
    set_back = np.where(np.arange(stamps.size) < stamps.size // 2, stamps, stamps - 500)
    found = imported(rewritten([f"{stamp:.6f}" for stamp in set_back]))
    assert any("1 interruptions" in note for note in found.notes)
    assert found.session.runs
    with pytest.raises(InputError, match="do not grow"):
        imported(rewritten(["0.000000"] * some.size))


def test_a_linear_axis_is_in_m_and_n_and_its_feed_is_asked_for(logged: Logged) -> None:
    said: dict[str, float] = {}
    for name, told in (
        ("position", "whose feed"),
        ("speed", "--speed-unit um/s"),
        ("torque", "permille=250"),
    ):
        with pytest.raises(InputError, match=told):
            imported(logged.log, said=said, axis="linear")
        said[name] = {"position": 1e-6, "speed": 1e-6, "torque": 0.25}[name]
    found = imported(logged.log, said=said, axis="linear")
    assert found.session.axis == "linear"
    assert any("position 1e-06 m" in note and "torque 0.25 N" in note for note in found.notes)


def test_positions_that_are_sent_on_events_are_refused(logged: Logged, tmp_path: Path) -> None:
    path = tmp_path / "events.log"
    lines = logged.lines()
    told = [re.sub(r"#2F(0[0-3])180201", r"#2F\g<1>1802FF", line) for line in lines]
    assert told != lines
    path.write_text("\n".join(told) + "\n")
    with pytest.raises(InputError, match="sent on events"):
        imported(path)


def test_what_the_log_does_not_hold_is_asked_for_by_name(
    logged: Logged, whole: Session, tmp_path: Path
) -> None:
    """Nobody read 608F, 6076 and 60A9: without answers to SDO reads of them nobody knows what a count is worth."""
    path = tmp_path / "late.log"
    silent = ("581#438F60", "581#437660", "581#4BA960", "581#43A960")
    path.write_text("\n".join(line for line in logged.lines() if not any(s in line for s in silent)) + "\n")
    with pytest.raises(InputError, match=r"node 1: .*encoder resolution.*--position-unit counts="):
        imported(path)
    said = {"position": 2 * np.pi / 1048576}
    with pytest.raises(InputError, match=r"speed unit \(60A9\).*--speed-unit"):
        imported(path, said=said)
    said["speed"] = 1e-3 * 2 * np.pi / 60
    with pytest.raises(InputError, match=r"rated torque \(6076\).*--torque-unit permille="):
        imported(path, said=said)
    said["torque"] = 0.07
    for run, same in zip(imported(path, said=said).session.runs, whole.runs, strict=True):
        np.testing.assert_allclose(run.torque_nm, same.torque_nm, rtol=1e-9)
        np.testing.assert_allclose(run.position_rad, same.position_rad, rtol=1e-3, atol=1e-3)


def test_lost_frames_are_not_bridged(logged: Logged, whole: Session, tmp_path: Path) -> None:
    """One TPDO is missing in the middle of the last run: that run ends there, the others are whole."""
    lines = logged.lines()
    middle = lines.index(next(line for line in reversed(lines[: int(0.93 * len(lines))]) if " 181#" in line))
    path = tmp_path / "lossy.log"
    path.write_text("\n".join(line for k, line in enumerate(lines) if k != middle) + "\n")
    found = imported(path)
    assert any("frames are missing" in note for note in found.notes)
    assert len(found.session.runs[0]) == len(whole.runs[0])
    assert sum(len(run) for run in found.session.runs) < sum(len(run) for run in whole.runs)


def test_a_log_that_begins_after_the_mapping_needs_the_dcf(logged: Logged, tmp_path: Path) -> None:
    """The EDS's own mapping is not the one that was used: frames are too short for it, or hold nothing of use."""
    lines = logged.lines()
    begin = next(k for k, line in enumerate(lines) if " 201#0F00" in line)
    path = tmp_path / "middle.log"
    path.write_text("\n".join(lines[begin:]) + "\n")
    scales = {"position": 6e-6, "speed": 1e-4, "torque": 0.07}
    with pytest.raises(InputError, match="DCF"):
        imported(path, said=scales)


@pytest.mark.parametrize(
    ("line", "told"),
    [("(1.0) can0 zzz", "line 2500: is no frame of a candump log"), ("(1.0) can0 181#123", "line 2500")],
)
def test_a_damaged_line_is_named(logged: Logged, tmp_path: Path, line: str, told: str) -> None:
    lines = logged.lines()
    lines[2499] = line
    path = tmp_path / "damaged.log"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=told):
        imported(path)


def test_a_log_that_was_cut_off_keeps_what_it_has(logged: Logged, tmp_path: Path) -> None:
    text = logged.log.read_text()
    path = tmp_path / "cut.log"
    path.write_text(text[: int(0.9 * len(text))])
    assert len(imported(path).session.runs) >= 2


def test_several_nodes_and_buses_are_asked_for(logged: Logged, tmp_path: Path) -> None:
    path = tmp_path / "two.log"
    other = [line.replace(" 181#", " 185#") for line in logged.lines() if " 181#" in line][:50]
    path.write_text("\n".join([*logged.lines(), *other]) + "\n")
    with pytest.raises(InputError, match=r"several nodes \(1, 5\).*--node 1"):
        imported(path)
    assert imported(path, node_id=1).session.runs
    path.write_text("\n".join([*logged.lines(), "(946684800.0) other 080#"]) + "\n")
    with pytest.raises(InputError, match=r"several buses \(desk-\d+, other\).*--channel desk-"):
        imported(path)


def test_the_command_line_imports_a_log(logged: Logged, tmp_path: Path) -> None:
    out = tmp_path / "s.h5"
    command = ["import", str(logged.log), "-o", str(out)]
    without = schwung(*command)
    assert without.returncode == 2
    assert "--eds" in without.stderr
    given = schwung(*command, "--eds", str(EDS))
    assert given.returncode == 0, given.stderr
    assert out.is_file()
