"""What a curve would take first, and what it leaves to laws."""

from pathlib import Path

import pytest
from sealed_sessions import drawn

from schwung.explain.weighing.weigh import weigh
from schwung.explain.weighing.work import Work


@pytest.mark.long
def test_two_laws_are_found_where_a_curve_promises_more_than_either(tmp_path: Path) -> None:
    """A drive that saturates, and friction that differs by direction: a curve over torque takes more of both than
    either law of its own, and beside it neither was missed."""
    session, machine, label = drawn(tmp_path, 213004, kind="two")
    found = weigh(session, machine)
    assert {name.name for name in found.names if name.probability > 0.9} == {
        effect["physics"] for effect in label["effects"]
    }
    (limit,) = (effect["parameters"] for effect in label["effects"] if "limit_nm" in effect["parameters"])
    (told,) = (name.parameters["limit_nm"] for name in found.names if name.name == "torque_saturation")
    assert told.value == pytest.approx(limit["limit_nm"], rel=2e-3)


@pytest.mark.long
def test_a_late_speed_beside_a_saturation_is_no_late_torque(tmp_path: Path) -> None:
    """Where the torque's lag may be off over the torque, it takes what is missed where that is clipped."""
    session, machine, label = drawn(tmp_path, 291500, kind="three")
    found = weigh(session, machine)
    assert {name.name for name in found.names if name.probability > 0.9} == {
        effect["physics"] for effect in label["effects"]
    }


@pytest.mark.long
@pytest.mark.timeout(300)
def test_laws_are_tried_beside_curves_that_were_found_soon(tmp_path: Path) -> None:
    """A curve over speed and one over torque and time took all there was, with most of the work left: laws alone were
    not looked for. Dry friction that a drag was found beside first falls near standstill, too."""
    session, machine, label = drawn(tmp_path, 299502, each=2, kind="three")
    found = weigh(session, machine)
    assert {name.name for name in found.names if name.probability > 0.9} == {
        effect["physics"] for effect in label["effects"]
    }
    assert not found.unnamed


def test_work_apart_counts_to_nothing_else() -> None:
    now = [0.0]
    work = Work(most=100.0, seconds=10.0, now=lambda: now[0])
    work.add(60.0)
    with work.apart(0.4):
        assert not work.spent
        work.add(41.0)
        now[0] = 4.5
        assert work.spent
    assert not work.spent
    assert work.done - work.most == pytest.approx(60.0 - 100.0)
    assert not work.hurried
    now[0] = 14.0
    assert not work.spent
    assert work.overdue(0.9)  # for what may take no more than that; the search goes on
    assert not work.hurried
    now[0] = 15.0
    assert work.spent
    assert work.hurried
