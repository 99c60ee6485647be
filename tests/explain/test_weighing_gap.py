"""The gap that a coupling with play shows, against one that another integrator moves."""

from functools import lru_cache

import numpy as np
import pytest
from integrated import RATE_HZ, sampled, view_of
from scipy.integrate import solve_ivp

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain.causes.present import Member
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.weighing.round import View, at_rest
from schwung.explain.weighing.sets import absent
from schwung.explain.weighing.settling import Settled, Weighing, settled, settled_beyond
from schwung.innovations.likelihood import Noise
from schwung.session.model import Run

ROTOR, LOAD, STIFFNESS, DAMPING, GAP = 2e-3, 1e-2, 3000.0, 1.0, 4e-4
MACHINE = Machine(
    name="two masses",
    motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=0.0, peak_torque_nm=20.0),
    coupling=Coupling(stiffness_nm_rad=STIFFNESS, damping_nms=DAMPING),
    load=Load(inertia_kgm2=LOAD, viscous_friction_nms=0.0),
)
#: Of torque, speed and angle: what the samples have, and what the filter is told.
NOISE = Noise(torque_nm=0.02, speed_rad_s=5e-3, position_rad=1e-6)


def torque(time, phase):
    """There and back, and a sine that opens the coupling again and again; it begins softly."""
    begun = 1 - np.exp(-((time / 0.02) ** 2))
    return begun * (5 * np.sin(2 * np.pi * 4 * time) + 3 * np.sin(2 * np.pi * 47 * time + phase))


def rates(time, state, phase):
    """Two masses, and between them a spring and damper that only push, beyond half the gap."""
    turned, speed, load_turned, load_speed = state
    twist, turning = turned - load_turned, speed - load_speed
    over = abs(twist) - GAP / 2
    pushed = max(STIFFNESS * over + DAMPING * np.sign(twist) * turning, 0.0) if over > 0 else 0.0
    carried = np.sign(twist) * pushed
    return [speed, (torque(time, phase) - carried) / ROTOR, load_speed, carried / LOAD]


def run_of(number: int) -> Run:
    """A quarter of a second at 2 kHz, sampled with noise."""
    phase = number * np.pi / 3
    time = np.arange(500) / RATE_HZ
    start = [0.0, 0.0, -GAP / 2, 0.0]
    moved = solve_ivp(rates, (0, time[-1]), start, "RK45", time, max_step=2e-5, args=(phase,)).y
    return sampled(number, time, moved, torque(time, phase), NOISE)


@lru_cache(maxsize=1)
def recorded() -> list[Run]:
    return [run_of(number) for number in range(3)]


WEIGHING = Weighing(NOISE, range(3), 1.0)


@pytest.fixture(scope="module")
def view() -> View:
    return view_of(recorded(), MACHINE)


@pytest.fixture(scope="module")
def play(view):
    return next(one for one in vocabulary(view.ranges, view.known) if one.name == "backlash")


def usual(view: View) -> Member:
    """A coupling whose damping may be another: all that is there without play."""
    return next(absent(one) for one in vocabulary(view.ranges, view.known) if one.name == "coupling_damping")


def missed(at: Settled) -> float:
    """Innovations' mean square: 1.17 of these runs without a gap; until it first touches nobody knows where it is."""
    return at.about.square(range(3)) / at.about.samples(range(3))


@pytest.mark.long
@pytest.mark.parametrize("begin", [GAP / 30, GAP / 3, 3 * GAP])
def test_from_wherever_it_begins_the_gap_comes_to_rest_where_it_is(view, play, begin):
    at = settled(
        view, [Member(play, play.shapes[0], np.array([begin, 0.0]), np.array(play.deviations))], WEIGHING
    )
    assert at.members[-1].coefficients[0] == pytest.approx(GAP, rel=0.01)
    assert missed(at) < 1.5


def softer(view: View) -> Member:
    """A coupling half as stiff as it is."""
    stiffness = next(c for c in vocabulary(view.ranges, view.known) if c.name == "coupling_stiffness")
    return Member(stiffness, (), np.array([-STIFFNESS / 2]), np.array(stiffness.deviations))


@pytest.mark.long
def test_what_is_hopeless_does_not_come_to_rest(view):
    def rest(least: float = -np.inf) -> tuple[Settled, float]:
        before = view.work.done
        return settled(view, [usual(view), softer(view)], WEIGHING, least), view.work.done - before

    found, took = rest()
    assert rest(found.log + 10)[0].log == found.log
    hopeless, less = rest(found.log + 1e4)
    assert less < 0.9 * took
    assert hopeless.log < found.log + 1e3


@pytest.mark.long
def test_what_is_worse_on_all_of_the_way_is_begun_where_it_leads(view):
    """A coupling with play seems softer, never twice as stiff; that it leads there and back was worth nothing."""
    nothing, stiff = settled(view, [usual(view)], WEIGHING), softer(view).candidate
    members, promised = (
        [*nothing.members, absent(stiff)],
        [nothing.members[0].coefficients, np.array([STIFFNESS])],
    )
    at = settled_beyond(nothing.about, members, promised, WEIGHING)
    assert at.log > nothing.log - 10


def test_a_gap_is_tried_whatever_a_line_promises(view, play):
    nothing = settled(view, [usual(view)], WEIGHING)
    members = [*nothing.members, absent(play)]
    at = settled_beyond(nothing.about, members, [np.zeros(1), np.zeros(2)], WEIGHING)
    assert at.members[-1].coefficients[0] == pytest.approx(GAP, rel=0.01)
    assert at.log > nothing.log + 1000


def test_a_gap_that_is_believed_leaves_nothing_to_find():
    believed = MACHINE.model_copy(
        update={
            "physics": MACHINE.model_validate(
                {**MACHINE.model_dump(), "physics": [{"name": "backlash", "gap_rad": GAP}]}
            ).physics
        }
    )
    about = at_rest(view_of(recorded(), believed), (), NOISE)
    assert about.square(range(3)) / about.samples(range(3)) < 1.5


def test_a_coupling_without_play_is_surer_than_one_with(view, play):
    """A gap foresees less, and that counts: else any would be likelier than none."""
    wider = settled(
        view, [Member(play, play.shapes[0], np.array([GAP, 0.0]), np.array(play.deviations))], WEIGHING
    )
    assert wider.about.unsure(range(3)) > 10
    assert settled(view, [usual(view)], WEIGHING).about.unsure(range(3)) == 0
