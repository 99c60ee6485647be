"""Parts of the page that need no browser: columns for the scope, drawings of a report, curves, words."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from schwung.commissioning.export import worth_of
from schwung.errors import InputError, RefusedError
from schwung.fieldbus.drive import Parameter
from schwung.fieldbus.profile import load_profile
from schwung.motion import Array
from schwung.quantities import parse_quantity
from schwung.report.colours import PALETTE
from schwung.service.pages.curves import NamedCurve, comparison_diagram, covered, inertia_diagram
from schwung.service.pages.decimation import BEGUN, CONTINUED, Columns, Decimator, frame, parts
from schwung.service.pages.desk import Desk
from schwung.service.pages.markup import Safe, problem, si, table, time_left
from schwung.service.pages.reported import drawings
from schwung.service.pages.runs import runs_table
from schwung.service.pages.scope import TRACES, Feed, Fresh
from schwung.service.pages.style import palette_css
from schwung.service.pages.words import cia402_meaning, cia402_tone, field_text
from schwung.service.service import Service
from schwung.service.values import Settings

RATE_HZ = 1000.0


def _signals(count: int, seed: int = 3) -> tuple[Array, Array]:
    noise = np.random.default_rng(seed).normal(size=(2, count))
    return np.arange(count) / RATE_HZ, noise


def _joined(found: list[Columns]) -> tuple[Array, Array]:
    return np.concatenate([c.low for c in found], axis=1), np.concatenate([c.high for c in found], axis=1)


@pytest.mark.parametrize("piece", [1, 7, 33, 1000])
def test_columns_keep_every_peak_however_samples_come(piece: int) -> None:
    time_s, values = _signals(1000)
    decimator, found = Decimator(2, 0.01, 500), []
    for begin in range(0, 1000, piece):
        found += decimator.feed(time_s[begin : begin + piece], values[:, begin : begin + piece])
    low, high = _joined(found + decimator.rest())
    blocks = values.reshape(2, 100, 10)  # ten samples a column
    np.testing.assert_array_equal(low, blocks.min(axis=2))
    np.testing.assert_array_equal(high, blocks.max(axis=2))


def test_a_gap_stays_a_gap_and_time_may_begin_anew() -> None:
    time_s, values = _signals(40)
    decimator = Decimator(2, 0.01, 500)
    decimator.feed(time_s[:20], values[:, :20])
    (over,) = decimator.feed(time_s[20:] + 0.05, values[:, 20:])
    assert np.isnan(over.low[:, 1:5]).all()  # the first is what was not full before the gap
    assert np.isfinite(over.low[:, -1]).all()
    again = decimator.feed(time_s[:20], values[:, :20])
    assert again[-1].start_s == 0.0


def test_nobody_gets_more_columns_than_he_can_draw() -> None:
    time_s, values = _signals(60_000)
    (found,) = Decimator(2, 0.001, 300).feed(time_s, values)
    assert found.low.shape == (2, 300)
    assert found.start_s == pytest.approx(59.699)


def test_a_frame_says_what_it_was_made_of() -> None:
    columns = Columns(
        1.25, 0.005, np.array([[1.0, np.nan], [3.0, -4.0]]), np.array([[2.0, np.nan], [5.0, 6.0]])
    )
    what, behind, told = parts(frame(columns, BEGUN, 7))
    assert (what, behind, told.start_s, told.width_s) == (BEGUN, 7, 1.25, 0.005)
    np.testing.assert_array_equal(told.low, columns.low)
    np.testing.assert_array_equal(told.high, columns.high)


def test_a_slow_client_gets_later_frames_and_no_queue() -> None:
    count = [0]

    def source(after: int, window_s: float) -> Fresh:
        times = np.arange(after, count[0]) / RATE_HZ
        kept = times[times >= times[-1] - window_s] if times.size else times
        return Fresh(count[0], kept, np.tile(kept, (len(TRACES), 1)))

    feed = Feed(source)
    feed.want(1.0, 200)
    assert parts(feed.frames()[0])[0] == BEGUN  # empty: the scope is cleared
    count[0] = 30_000
    (late,) = feed.frames()  # half a minute at once
    what, _, columns = parts(late)
    assert what == CONTINUED
    assert columns.low.shape[1] <= 200
    assert len(late) < 10_000
    assert feed.frames() == []
    feed.want(0.1, 100)
    assert parts(feed.frames()[0])[0] == BEGUN


def test_a_short_window_has_no_gaps_between_samples() -> None:
    """Half a second on a thousand columns: fewer samples than columns; each column that is sent has one."""
    count = [300]

    def source(after: int, _window_s: float) -> Fresh:
        times = 0.05 + np.arange(after, count[0]) / RATE_HZ
        return Fresh(count[0], times, np.tile(times, (len(TRACES), 1)))

    feed = Feed(source)
    feed.want(0.5, 1000)
    (first,) = feed.frames()
    count[0] = 500
    (more,) = feed.frames()
    told = [parts(sent) for sent in (first, more)]
    assert [what for what, _, _ in told] == [BEGUN, CONTINUED]
    low = np.concatenate([columns.low for _, _, columns in told], axis=1)
    assert low.shape[1] > 300
    assert np.isfinite(low).all()


def test_drawings_of_a_report_and_nothing_that_acts() -> None:
    good = '<svg viewBox="0 0 1 1"><style>*{x:y}</style><path d="M0 0"/><use href="#a"/></svg>'
    page = f"<section><h2>A &amp; B</h2><figure>{good}\n<figcaption>See &lt;this&gt;</figcaption></figure></section>"
    (drawing,) = drawings(page)
    assert (drawing.title, drawing.caption) == ("A & B", "See <this>")
    assert "<style" not in drawing.svg
    for bad in (
        "<script>1</script>",
        '<a onclick="x()">',
        '<image href="http://elsewhere/x.png"/>',
        "<foreignObject/>",
    ):
        assert list(drawings(page.replace("<path", f"{bad}<path"))) == []


def _curve(name: str, level: float, low: float = 0.0, high: float = 3.0) -> NamedCurve:
    angle = np.linspace(low, high, 31)
    return NamedCurve(name, angle, np.full(31, level), np.full(31, 0.01))


def test_the_range_of_earlier_runs_ends_where_they_end() -> None:
    now = _curve("now", 0.1)
    low, high = covered(now.position_rad, [_curve("a", 0.08, 0.0, 2.0), _curve("b", 0.12, 0.5, 2.0)])
    assert low[0] == high[0] == 0.08  # only one was there
    assert (low[15], high[15]) == (0.08, 0.12)
    assert np.isnan(low[-1])
    drawn = inertia_diagram(now, [_curve("a", 0.08, 0.0, 2.0)])["panels"][0]["series"]
    assert drawn[0]["low"][-1] is None  # a gap in JSON, no NaN
    beside = comparison_diagram([now, _curve("elsewhere", 0.1, 5.0, 8.0)])
    assert set(beside["panels"][1]["series"][-1]["y"]) == {None}


def test_words() -> None:
    assert [si(v) for v in (0.0, -0.05, 123.456, 1.5e-7, float("nan"), None)] == [
        "0",
        "−0.05000",
        "123.5",
        "1.500e−7",
        "–",
        "–",
    ]
    assert [time_left(s) for s in (None, 0.2, 30.0, 600.0)] == ["", "1 s left", "30 s left", "10 min left"]
    assert cia402_tone("Fault") == "unusable"
    assert "torque" in cia402_meaning("Switched on")
    assert field_text("speed_max_rad_s3", 2.5) == ("Speed max", "2.5 rad/s³")
    told = problem(RefusedError("bus <1>", "is full", "Use a faster one."))
    assert "bus &lt;1&gt;: is full" in told
    assert "Use a faster one." in told
    assert "<b>" not in table(("A",), [("<b>",)])
    assert "<b>" in table(("A",), [(Safe("<b>x</b>"),)])


def test_both_themes_have_every_colour() -> None:
    css = palette_css()
    for colour in PALETTE:
        assert f"--{colour.name}:{colour.light};" in css
        assert f"--{colour.name}:{colour.dark};" in css


def test_quantities_with_and_without_units() -> None:
    assert parse_quantity(" 180 deg", "angle", "x") == pytest.approx(np.pi)
    assert parse_quantity("-.5", "angle", "x", signed=True) == -0.5
    for text in ("", "fast", "0", "-1", "1e999", "3 km"):
        with pytest.raises(InputError, match="Stroke"):
            parse_quantity(text, "angle", "Stroke")


def test_what_an_export_writes_has_its_unit() -> None:
    profile = load_profile("schwung-bench")
    table_value = worth_of(profile, Parameter(0x2300, 5, "UNSIGNED32"))
    assert table_value is not None
    assert (table_value.scale, table_value.unit) == (1e-7, "kg·m²")
    angle = worth_of(profile, Parameter(0x2301, 2, "UNSIGNED32"))
    assert angle is not None
    assert (angle.scale, angle.unit) == (1e-6, "rad")
    assert worth_of(profile, Parameter(0x6065, 0, "UNSIGNED32")) is None


def test_a_long_list_reads_no_document_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """300 plans are megabytes: a page that looks every second may not read them each time."""
    with Service(Settings(tmp_path)) as service:
        for number in range(320):
            run = service.store.add_run("plan", {"kind": "plan"}, f"<b>{number}</b>", None, None)
            service.store.end_run(run.id, "failed", None, {"text": f"no. {number}"})
        desk = Desk(service, may_act=True, who="tester")
        first = runs_table(desk)
        assert first.count("<tr>") == 301  # with its head
        assert "no. 319" in first
        assert "&lt;b&gt;319" in first

        def read(run_id: str) -> NoReturn:
            raise AssertionError(run_id)

        monkeypatch.setattr(service.store, "run", read)
        assert runs_table(desk) == first
