"""What weighing costs, in numbers worked out: no more than it did, and no more than it may."""

from itertools import count
from threading import Thread  # noqa: TID251  (what a program beside us does)

import pytest
from sealed_sessions import drawn
from strangers import Stranger, belief_of, session_of
from threadpoolctl import threadpool_info, threadpool_limits

from schwung.compiled import computing_s
from schwung.explain.weighing.weigh import posterior_of
from schwung.explain.weighing.work import MOST, Work, on_one_thread

DRY = Stranger("dry friction", ("coulomb_friction",), (0.8, 0.0, 0.0, 0.0))
#: Whitened numbers that this session took on 2026-11-22, and what is no surprise.
TAKEN, BESIDE = 2.25e8, 0.15


@pytest.fixture(scope="module")
def recorded():
    return session_of(DRY, 5, every=8, times=(0.25,)), belief_of(DRY)


@pytest.mark.long
def test_a_plain_session_takes_no_more_work_than_it_did(recorded):
    posterior = posterior_of(*recorded)
    assert posterior.told.probability("coulomb_friction") > 0.95
    assert not posterior.told.notes
    assert TAKEN / 3 < posterior.view.work.done < (1 + BESIDE) * TAKEN


@pytest.mark.long
def test_where_work_is_spent_the_search_ends_and_says_so(recorded, monkeypatch):
    most = TAKEN / 2
    monkeypatch.setattr(Work, "spent", property(lambda self: self.done > most))
    monkeypatch.setattr(Work, "late", property(lambda self: self.done > 1.2 * most))
    posterior = posterior_of(*recorded)
    told = posterior.told
    assert any("the search ended before all was tried" in note for note in told.notes)
    assert posterior.view.work.done < 0.85 * TAKEN  # what was begun is ended


@pytest.mark.long
def test_where_the_processors_time_is_spent_the_search_ends_and_says_so(recorded):
    def hurried():
        seconds = count()  # one at each question
        return posterior_of(*recorded, work=Work(seconds=20.0, now=lambda: next(seconds)))

    one, again = hurried(), hurried()
    assert any("processor time was spent, before all was tried" in note for note in one.told.notes)
    assert one.view.work.done < 0.8 * TAKEN
    assert one.names == again.names


@pytest.mark.long
def test_a_search_that_ends_early_is_not_sure_of_what_came_first(tmp_path):
    """A torque constant that fades was found before one that is off, which was not asked in its place: 0.997."""
    session, machine, label = drawn(tmp_path, 640002, kind="three")
    told = posterior_of(session, machine, work=Work(most=0.3 * MOST, now=lambda: 0.0)).told
    assert any("the search ended before all was tried" in note for note in told.notes)
    true = {effect["physics"] for effect in label["effects"]}
    assert {one.name for one in told.names if one.probability > 0.5} <= true


def test_time_that_is_left_changes_nothing():
    seconds = iter([5.0, 64.0, 65.5, 100.0])
    work = Work(seconds=60.0, now=lambda: next(seconds))
    assert not work.spent
    assert not work.hurried
    assert work.spent  # after 60.5 s
    assert work.hurried
    assert work.late


def test_what_is_looked_for_apart_has_a_limit_together():
    """Each for itself, four searches made two minutes of the 50 s that a session may take."""
    work = Work(most=1000.0, now=lambda: 0.0)
    for spent, enough in ((0.3, False), (0.3, False), (0.2, True)):
        with work.apart(0.3):
            work.add(1000.0 * spent - 1)
            assert work.spent == enough
    assert not work.spent
    work.add(1100.0)
    assert work.spent


def test_what_is_kept_for_the_end_is_used_once():
    """A search may end more than once: of a few runs' causes, and of laws alone."""
    work = Work(most=1000.0, now=lambda: 0.0)
    work.add(1001.0)
    for enough in (False, True):
        assert work.spent
        with work.ending():
            work.add(60.0)
            assert work.spent == enough
    assert work.spent
    with work.apart(0.3):
        assert not work.spent


def test_what_all_runs_are_asked_besides_is_no_part_of_what_a_few_may_take():
    work = Work(most=100.0, seconds=1e9)
    with work.within(0.3):
        work.add(20.0)
        with work.besides():
            work.add(50.0)
        work.add(9.0)
        assert not work.spent
        work.add(2.0)
        assert work.spent
    assert not work.spent
    work.add(20.0)
    assert work.spent  # but of all that may be done it is


def test_what_is_looked_for_apart_takes_no_more_for_what_is_asked_besides():
    work = Work(most=100.0, seconds=1e9)
    with work.apart(0.3):
        with work.besides():
            work.add(20.0)
        work.add(11.0)
        assert work.spent


def test_room_is_used_again():
    work = Work()
    first = work.rows(3, 5)
    first[:] = 1.0
    assert work.rows(2, 4).base is first.base
    assert work.rows(4, 5).shape == (4, 5)


def test_linear_algebra_has_one_thread_while_it_is_weighed() -> None:
    """A program that imports us has as many as the computer has processors, and each counts."""

    @on_one_thread
    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        assert threads() == {1}
        assert {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"} == {2}


def test_what_other_threads_compute_is_not_counted() -> None:
    began = computing_s()
    other = Thread(target=lambda: sum(number * number for number in range(3_000_000)))
    other.start()
    other.join()
    assert computing_s() - began < 0.05
