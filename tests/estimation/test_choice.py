"""The method that a session allows is taken, and the reason told; several frequencies make one table."""

import numpy as np
import pytest
from estimation_plant import crank, noisy, phases, session_of

from schwung.drivetrain.inertia import InertiaTable
from schwung.errors import InputError
from schwung.estimation import estimate
from schwung.estimation.choice import choose, leaves_much, motion_over_injection
from schwung.estimation.methods import METHODS, Outcome, Suitability, Task, register
from schwung.estimation.table import combine_tables


@pytest.fixture(scope="module")
def four():
    return phases(0.25, rate=1000.0)


def chosen(session, machine):
    return choose(Task(session, session.excited, machine, 50.0, "complex"))


def test_four_phases_before_a_reference_before_none(four, bus_rate, machine):
    both = session_of(bus_rate.references[0], *four.runs)
    assert chosen(both, machine).method.name == "multiphase"
    assert chosen(bus_rate, machine).method.name == "denoised"
    assert chosen(session_of(*bus_rate.excited), machine).method.name == "trajectory"


def test_clipped_torque_wants_the_whole_trajectory(clipped, machine):
    choice = chosen(clipped, machine)
    assert choice.method.name == "trajectory"
    assert "clipped in up to" in choice.reason


def test_the_reason_is_told_and_a_name_overrides(four, machine, estimated):
    found = estimated(four, machine)
    assert found.notes[0].startswith("Method multiphase was chosen: 4 equally spaced phases")
    named = estimate(four, machine, "former")
    assert named.method == "former"
    assert not any("was chosen" in note for note in named.notes)


def test_any_registered_method_may_take_part(four, machine):
    class Best:
        name = "best-of-tests"
        needs_reference = False

        def suits(self, task):
            return Suitability(99.0, "the test says so")

        def traces(self, task):
            raise InputError("best", "was asked")

    register(Best())
    try:
        with pytest.raises(InputError, match="was asked"):
            estimate(four, machine)
    finally:
        del METHODS["best-of-tests"]


def test_frequencies_are_combined(bus_rate, fractional, machine):
    both = session_of(*bus_rate.runs, *(noisy(run, 1) for run in fractional.runs))
    result = estimate(both, machine, "denoised")
    each = [estimate(both, machine, "denoised", frequency_hz=f) for f in (47.0, 50.0)]
    assert len(result.traces) == 2
    assert any("inverse variance: 47 Hz" in note for note in result.notes)

    def rmse(found):
        return np.sqrt(np.mean((found.table.inertia_kgm2 - crank(found.table.position_rad)) ** 2))

    assert rmse(result) < max(rmse(found) for found in each)


def test_inverse_variance_by_hand():
    angle = np.array([0.0, 1.0, 2.0])
    one = InertiaTable(angle, np.array([0.1, 0.1, 0.1]), np.array([0.01, 0.01, 0.01]))
    other = InertiaTable(angle, np.array([0.11, 0.11, 0.2]), np.array([0.02, 0.02, 0.02]))
    table, shares = combine_tables([one, other])
    assert shares == pytest.approx([0.8, 0.2])
    np.testing.assert_allclose(table.inertia_kgm2, [0.102, 0.102, 0.12])
    agreed = 1 / np.sqrt(1 / 0.01**2 + 1 / 0.02**2)
    np.testing.assert_allclose(table.std_kgm2[:2], agreed)
    assert table.std_kgm2[2] > 4 * agreed, "tables that disagree widen the band"


def test_outside_a_table_it_has_no_say():
    wide = InertiaTable(np.linspace(0, 4, 5), np.full(5, 0.1), np.full(5, 0.01))
    narrow = InertiaTable(np.array([0.0, 1.0]), np.array([0.2, 0.2]), np.array([0.01, 0.01]))
    table, _ = combine_tables([wide, narrow])
    np.testing.assert_allclose(table.inertia_kgm2, [0.15, 0.15, 0.1, 0.1, 0.1])
    bare = InertiaTable(np.linspace(0, 4, 5), np.full(5, 0.3))
    assert combine_tables([wide, bare])[1] == pytest.approx([0.5, 0.5])


def test_a_record_that_tells_more_is_asked_for_it(bus_rate, machine, estimated):
    """Windows leave most of it idle: the trajectory fit takes their place, what they saw of the ripple stays."""
    found, windows = estimated(bus_rate, machine), estimated(bus_rate, machine, "denoised")
    assert found.method == "trajectory"
    assert any("was taken: it uses motion and injection together" in note for note in found.notes)
    assert len(found.traces) == len(found.denoised) == 1
    assert found.trust.miv_kgm2 == windows.trust.miv_kgm2 > 0
    assert found.table.std_kgm2.max() < windows.table.std_kgm2.mean()

    def rmse(of):
        return np.sqrt(np.mean((of.table.inertia_kgm2 - crank(of.table.position_rad)) ** 2))

    assert rmse(found) < rmse(windows) / 10


def test_phases_suffice_as_long_as_the_injection_tells_most(four, machine, estimated):
    def task(session):
        return Task(session, session.excited, machine, 50.0, "complex")

    faster = phases(0.15, rate=1000.0)
    assert motion_over_injection(task(four)) < 1 < motion_over_injection(task(faster))
    assert not leaves_much(task(four), windowed=False)
    assert leaves_much(task(faster), windowed=False)
    assert estimated(four, machine).method == "multiphase"
    assert estimate(faster, machine).method == "trajectory"


def test_a_long_record_is_not_gone_through_once_more(bus_rate, machine, monkeypatch):
    monkeypatch.setattr("schwung.estimation.choice.MOST_SAMPLES", 100)
    assert estimate(bus_rate, machine).method == "denoised"


@pytest.fixture
def soft(machine):
    """A machine file whose stiffness is far too low."""
    coupling = machine.coupling.model_copy(
        update={"stiffness_nm_rad": 0.7 * machine.coupling.stiffness_nm_rad}
    )
    return machine.model_copy(update={"coupling": coupling})


@pytest.mark.parametrize("better", [True, False])
def test_a_favourite_in_doubt_gives_way_to_a_robust_method_that_does_better(four, soft, better, monkeypatch):
    class Sturdy:
        name = "sturdy"
        needs_reference = False
        robust = True

        def suits(self, task):
            return Suitability(0.9, "the test says so")

        def traces(self, task):
            """The truth, or twice that."""
            angle = np.linspace(0.05, 3.1, 64)
            return Outcome(table=InertiaTable(angle, (1 if better else 2) * crank(angle)), windowed=False,
                           machine=machine_as_it_is(task.machine))  # fmt: skip

    def machine_as_it_is(believed):
        stiffer = {"stiffness_nm_rad": believed.coupling.stiffness_nm_rad / 0.7}
        return believed.model_copy(update={"coupling": believed.coupling.model_copy(update=stiffer)})

    monkeypatch.setitem(METHODS, "sturdy", Sturdy())
    monkeypatch.delitem(METHODS, "trajectory")
    found = estimate(four, soft)
    assert found.method == ("sturdy" if better else "multiphase")
    told = [
        note for note in found.notes if note.startswith("Method multiphase is in doubt (expected error about")
    ]
    assert len(told) == 1
    assert ("was taken" if better else "does no better") in told[0]
    assert (found.trust.verdict == "good") == better


def test_a_robust_method_that_refuses_leaves_the_favourite(four, soft, monkeypatch):
    class Refuses:
        name = "refuses"
        needs_reference = False
        robust = True

        def suits(self, task):
            return Suitability(0.9, "the test says so")

        def traces(self, task):
            raise InputError("session", "is not to its taste")

    monkeypatch.setitem(METHODS, "refuses", Refuses())
    monkeypatch.delitem(METHODS, "trajectory")
    found = estimate(four, soft)
    assert (found.method, found.trust.verdict == "good") == ("multiphase", False)
    assert any("refuses cannot be used" in note and "not to its taste" in note for note in found.notes)
    assert estimate(four, soft, "multiphase").notes[:1] != found.notes[:1], "a named method asks no other"
