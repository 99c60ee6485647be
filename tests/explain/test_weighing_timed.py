"""Which of torque and speed is late, by how much, and what no recording tells of that."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.known import known
from schwung.explain.causes.present import Member
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.weighing.search import Pick, Scored
from schwung.explain.weighing.sets import absent, timed
from schwung.explain.weighing.told import as_told, told_by
from schwung.innovations.effect import Effect

RANGES = Ranges(0.5, 4.5, 50.0, 2000.0, 40.0, 1.0, 0.1, 8, 160.0)
USUAL = {"usual_filter": 2.2e-4, "usual_torque_timing": -1.7e-4, "usual_speed_timing": 1.9e-4}


@pytest.fixture(scope="module")
def candidates() -> dict[str, Candidate]:
    machine = Machine(
        name="coupled",
        motor=Motor(inertia_kgm2=0.1, viscous_friction_nms=0.0, peak_torque_nm=40.0),
        coupling=Coupling(stiffness_nm_rad=9000.0, damping_nms=2.0),
        load=Load(inertia_kgm2=0.1),
    )
    return {one.name: one for one in vocabulary(RANGES, known(machine, 0.5, 4.5))}


def present(candidates: dict[str, Candidate], times: dict[str, float]) -> list[Member]:
    """Members that are late by these."""
    found = []
    for name, time in times.items():
        member = absent(candidates[name])
        member.coefficients[0] = time
        found.append(member)
    return found


def lateness(members: list[Member]) -> np.ndarray:
    """Of torque and speed, to first order (s)."""
    return np.sum([float(m.coefficients[0]) * np.array(m.candidate.late) for m in members], axis=0)


@pytest.mark.parametrize("beside", [{}, {"torque_lag": 3e-4}, {"measurement_delay": 2e-4}])
@pytest.mark.parametrize("name", ["torque_lag", "measurement_delay"])
def test_every_late_cause_says_the_same_to_first_order(
    candidates, name: str, beside: dict[str, float]
) -> None:
    before = present(candidates, USUAL | beside)
    after = timed(before, candidates[name])
    assert after is not None
    assert lateness(after) == pytest.approx(lateness(before))
    assert [m.candidate.name for m in after if m.candidate.named] == [name]
    late = after[-1]
    assert late.coefficients[0] == pytest.approx(np.diff(lateness(before))[0])
    assert 0.5 <= late.shape[0] / late.coefficients[0] <= 1.0


def test_a_torque_that_is_reported_late_is_none_where_the_speed_is_later(candidates) -> None:
    assert timed(present(candidates, USUAL), candidates["torque_filter"]) is None
    early = {"usual_torque_timing": 1.7e-4, "usual_speed_timing": -1.9e-4}
    assert timed(present(candidates, USUAL | early), candidates["torque_filter"]) is not None


def test_what_is_as_often_nothing_counts_as_both() -> None:
    """By the integral over what it may be: half of it at nothing, half of it above."""
    sometimes = Candidate("filter", lambda *_: Effect(), (3.0,), positive=(0,), often_none=True)
    for mean, wide in ((-0.6, 0.5), (0.0, 0.5), (2.0, 0.5)):
        likely = quad(lambda x, m=mean, w=wide: norm.pdf(x, m, w), 0, 30)[0]  # of the data, the prior's in it
        both = 0.5 * 2 * likely + 0.5 * norm.pdf(0, mean, wide) / norm.pdf(0, 0, 3.0)
        found = sometimes.allowed(np.array([mean]), np.array([wide]), np.array([3.0]))
        assert found == pytest.approx(np.log(both))


def test_a_late_cause_that_bends_as_none_does_is_less_likely(candidates) -> None:
    lag, delay = candidates["torque_lag"], np.array([3e-4])
    off = [abs(lag.unbent((share * 3e-4, 0.0), delay)[0]) for share in (0.75, 0.5, 0.0)]
    assert off == pytest.approx([0.0, 0.5, 1.5])
    assert all(one < other for one, other in pairwise(off))


def late_set(candidates, name: str, gain: float = 1.0) -> tuple[SimpleNamespace, Scored, np.ndarray]:
    """A set with one late cause, which is as late as what is usual is, and where the first number of each is; `gain`:
    with a torque constant that is off as well."""
    usual = [candidates[one] for one in USUAL]
    own = [candidates[name], candidates["torque_constant"]][: 1 if gain == 1 else 2]
    search = SimpleNamespace(
        always=(0, 1, 2),
        data=SimpleNamespace(
            candidates=[*usual, *own], atoms=[SimpleNamespace(shape=shape) for shape in ((2e-4, 0.0), ())]
        ),
        candidate=lambda pick: own[pick.atom],
        name=lambda pick: own[pick.atom].name,
    )
    first = np.cumsum([0, *(one.size for one in usual)])
    exact = np.full(first[-1] + len(own), 1e-8)
    exact[first] = [*USUAL.values(), 3e-4]
    exact[first[-1] + 1 :] = gain - 1
    return (
        search,
        Scored(
            tuple(Pick(i, 1.0) for i in range(len(own))),
            0.0,
            None,
            np.arange(exact.size),
            np.ones(exact.size),
            exact,
        ),
        first,
    )


@pytest.mark.parametrize("name", ["torque_lag", "measurement_delay"])
def test_a_late_cause_is_told_as_all_that_torque_and_speed_are_apart_by(candidates, name: str) -> None:
    """How much of that is usual only bends say, badly: a delay of 0.70 ms behind a filter was told as 0.98. As a whole
    each signal bends as it did, though a file's lag is one of first order, and its delay a delay."""
    search, whole, first = late_set(candidates, name)
    exact = whole.exact
    found = as_told(search, whole).exact
    late = np.array([one.late for one in search.data.candidates])
    assert found[first] @ late == pytest.approx(exact[first] @ late)
    assert found[first][1:-1].tolist() == [0.0, 0.0]
    bends = {"torque_lag": 1.0, "measurement_delay": 0.5}[name] * found[-1] ** 2
    own, other = (first[i] + 1 for i in ((1, 2) if name == "torque_lag" else (2, 1)))
    assert found[own] + bends == pytest.approx(exact[own] + 3e-4 * 2e-4)
    assert found[other] == exact[other]


@pytest.mark.parametrize("name", ["torque_lag", "measurement_delay"])
def test_beside_a_torque_constant_it_is_the_true_torque_that_is_late(candidates, name: str) -> None:
    """Of 1.3 times the torque, a lag of 0.3 ms makes as much as one of 0.39 ms of what is reported, which was told."""
    gain = 1.3
    search, whole, first = late_set(candidates, name, gain)
    found = as_told(search, whole).exact
    late = np.array([one.late for one in search.data.candidates[:4]])
    torque, speed = whole.exact[first] @ late
    assert found[first] @ late == pytest.approx([torque / gain, speed])
    assert found[-1] == gain - 1
    bends = gain * found[first[-1]] ** 2 if name == "torque_lag" else 0.5 * found[first[-1]] ** 2
    own = first[1 if name == "torque_lag" else 2] + 1
    assert found[own] + bends == pytest.approx(whole.exact[own] + 3e-4 * 2e-4)


@pytest.mark.parametrize("name", ["torque_lag", "measurement_delay"])
def test_a_late_cause_is_known_as_well_as_what_torque_and_speed_are_apart_by(candidates, name: str) -> None:
    """Not as badly as how much of that is usual: where each signal's lateness is known to a microsecond, the interval
    of a lag of 0.3 ms was 40 % wide, and its error a thousandth of that."""
    search, whole, first = late_set(candidates, name)
    late = np.zeros((2, whole.exact.size))
    late[:, first] = np.array([one.late for one in search.data.candidates]).T
    covariance = np.linalg.inv(np.eye(whole.exact.size) / 1e-4**2 + late.T @ late / 1e-6**2)
    told = told_by(search, whole)[first[-1]]
    assert np.sqrt(covariance[first[-1], first[-1]]) > 4e-5
    assert np.sqrt(told @ covariance @ told) == pytest.approx(np.sqrt(2) * 1e-6, rel=1e-3)
    assert told @ whole.exact == as_told(search, whole).exact[first[-1]]
