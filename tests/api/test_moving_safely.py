"""A program that moves a machine is held to what the command line is: asked, looked at, stopped on every way out."""

import io
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import pytest

import schwung
from schwung_sim.bench import Bench

_channels = count()
WISHES = schwung.Wishes(distance_rad=1.0, duration_s=0.25, repeats=1)


@dataclass
class Room:
    bench: Bench
    connection: schwung.Connection

    def plan(self) -> schwung.Plan:
        return schwung.plan(self.connection, schwung.example_machine(), WISHES)

    def turn_by_hand(self, by_rad: float) -> None:
        """Motor and load, while the drive is off."""
        state = self.bench.plant.state  # type: ignore[attr-defined]  # the two-mass plant's own
        for name in state.dtype.names:
            if name.endswith("_rad"):
                state[name] += by_rad
        self.connection.drive.clock.sleep(0.01)

    @property
    def has_moved(self) -> bool:
        return abs(self.bench.axis.position_rad) > 1e-3

    @property
    def is_off(self) -> bool:
        return not self.bench.servo.power.energised


@pytest.fixture
def room() -> Iterator[Room]:
    channel = f"safely-{next(_channels)}"
    with (
        Bench("two-mass", channel=channel, node_id=1) as bench,
        schwung.connect("stepped", channel) as connection,
    ):
        yield Room(bench, connection)


def test_nobody_to_ask_is_a_no(room: Room, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    with pytest.raises(schwung.RefusedError, match="found nobody to answer"):
        schwung.commission(room.connection, room.plan(), tmp_path / "out")
    assert not room.has_moved
    assert not (tmp_path / "out").exists()


def test_whoever_sits_in_front_is_asked(
    room: Room, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("Yes\n"))
    done = schwung.commission(room.connection, room.plan(), tmp_path / "out")
    assert "The machine will move" in capsys.readouterr().out
    assert done.estimate.trust.verdict == "good"
    assert schwung.load_machine(tmp_path / "out" / "measured.toml").load.trust == "good"
    assert room.is_off


def test_a_plan_for_where_the_axis_stood_is_refused(room: Room, tmp_path: Path) -> None:
    plan = room.plan()
    room.turn_by_hand(0.9)
    with pytest.raises(schwung.RefusedError, match=r"starts at 0 rad, the axis stands at 0\.9"):
        schwung.commission(room.connection, plan, tmp_path / "out", confirm=lambda _question: True)
    assert not (tmp_path / "out").exists()


def test_a_plan_begins_where_the_axis_stands_now(room: Room, tmp_path: Path) -> None:
    plan = room.plan()
    room.turn_by_hand(0.02)
    done = schwung.commission(room.connection, plan, tmp_path / "out", confirm=lambda _question: True)
    assert done.prepared.plan.start_position_rad == pytest.approx(0.02, abs=1e-4)


def test_an_observer_that_fails_stops_the_drive(room: Room, tmp_path: Path) -> None:
    class Failing:
        def phase(self, text: str) -> None:
            if text.startswith("Motion 2"):
                raise ZeroDivisionError

        def progress(self, done: int, total: int) -> None: ...

        def note(self, text: str) -> None: ...

    with pytest.raises(ZeroDivisionError):
        schwung.commission(
            room.connection, room.plan(), tmp_path, confirm=lambda _question: True, observer=Failing()
        )
    assert room.is_off
    assert len(schwung.read_session(tmp_path / "session.h5").runs) == 1


def test_an_exception_within_the_block_switches_off_what_we_have_switched_on() -> None:
    with Bench("two-mass", channel="left", node_id=1) as bench:

        def work() -> None:
            with schwung.connect("stepped", "left") as connection:
                acquisition = schwung.plan(connection, schwung.example_machine(), WISHES).plan.acquisition
                connection.drive.write(connection.drive.setup(acquisition))
                connection.drive.start(acquisition)
                connection.drive.enable()
                assert bench.servo.power.energised
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            work()
        assert bench.servo.settle(3.0)
        assert not bench.servo.power.energised


def test_an_unusable_table_does_not_go_into_a_drive(room: Room, tmp_path: Path) -> None:
    done = schwung.commission(room.connection, room.plan(), tmp_path, confirm=lambda _question: True)
    trust = replace(done.estimate.trust, verdict="unusable")
    spoilt = replace(done, estimate=replace(done.estimate, trust=trust))
    with pytest.raises(schwung.RefusedError, match="unusable"):
        schwung.export(room.connection, spoilt, confirm=lambda _question: True)


def test_a_table_is_exported_as_it_was_shown(room: Room, tmp_path: Path) -> None:
    table = schwung.read_inertia(_table(tmp_path / "table.csv"))
    shown = schwung.plan_export(room.connection, table, "max")
    written = schwung.export(room.connection, table, "max", tmp_path / "out", confirm=lambda _question: True)
    assert [(c.parameter, c.new) for c in written.changes] == [(c.parameter, c.new) for c in shown]
    assert written.after is None
    with pytest.raises(schwung.RefusedError, match="you said no"):
        schwung.export(room.connection, table, "max", tmp_path / "no", confirm=lambda _question: False)
    with pytest.raises(schwung.InputError, match="host: writes nothing"):
        schwung.export(room.connection, table, "host", tmp_path / "no", confirm=lambda _question: True)
    assert not (tmp_path / "no").exists()


def _table(path: Path) -> Path:
    path.write_text("position_rad,inertia_kgm2\n0,0.1\n1,0.3\n", encoding="utf-8")
    return path
