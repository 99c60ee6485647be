"""Columns against the filter itself, their products against the columns, and a refined shape against its neighbours."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from strangers import STRANGERS, Stranger, belief_of, session_of

from schwung.explain.causes.along import ranges_of
from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.curves import Curve, Plane
from schwung.explain.causes.equations import Acting, equations_of
from schwung.explain.causes.known import known
from schwung.explain.causes.present import Member
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.publishing.places import Acts
from schwung.explain.weighing import offers
from schwung.explain.weighing import round as rounds
from schwung.explain.weighing.data import Data
from schwung.explain.weighing.offers import (
    _neighbours,
    across_instead,
    bending_instead,
    instead_of_each,
    numbers_beside,
    numbers_together,
    offered,
)
from schwung.explain.weighing.refine import refined
from schwung.explain.weighing.repeated import _curve
from schwung.explain.weighing.search import HOPELESS, Pick, Search, slices
from schwung.explain.weighing.sets import absent, members_of
from schwung.explain.weighing.sharpness import covariance_of
from schwung.explain.weighing.standing import taken_as_told
from schwung.explain.weighing.weigh import _rms, weigh
from schwung.explain.weighing.work import Work
from schwung.innovations.effect import Effect, Passed
from schwung.innovations.evidence import weigh as weigh_columns
from schwung.innovations.likelihood import first_noise, likely_noise
from schwung.innovations.signals import signals_of

SPOT = Stranger("tight spot", ("local_friction",), spot=(1.2, 2.0, 0.5))


@pytest.fixture(scope="module")
def view():
    """Four runs of a machine with a tight spot."""
    session, machine = session_of(SPOT, 5, every=8, times=(0.25,)), belief_of(SPOT)
    runs = tuple(signals_of(run, machine, 160.0, 0.0) for run in session.runs)
    of = ranges_of(list(runs), 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.smooth_nm) for run in runs)
    return rounds.View(session.runs, runs, known(machine, of.low_rad, of.high_rad), of, torques)


@pytest.fixture
def data(view):
    """All causes, about the belief, on three of the runs."""
    candidates = vocabulary(view.ranges, view.known)
    members = [Member(c, c.shapes[0], np.zeros(c.size), np.array(c.deviations)) for c in candidates[:3]]
    about = rounds.linearised(view, members, first_noise(view.runs), None)
    return Data.of(about, members, candidates, (0, 1, 3), 2.0)


def _searched(gain: float, share: float) -> Search:
    """About a belief of whose torque so much is reported, and which knows of so much of the load."""
    session, machine = session_of(SPOT, 5, every=8, times=(0.25,)), belief_of(SPOT)
    load = machine.load.model_copy(update={"inertia_kgm2": share * machine.load.inertia_kgm2})
    machine = machine.model_copy(update={"load": load})
    recorded = tuple(replace(run, torque_nm=gain * run.torque_nm) for run in session.runs)
    runs = tuple(signals_of(run, machine, 160.0, 0.0) for run in recorded)
    of = ranges_of(list(runs), 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.smooth_nm) for run in runs)
    view = rounds.View(recorded, runs, known(machine, of.low_rad, of.high_rad), of, torques)
    candidates = vocabulary(view.ranges, view.known)
    members = [absent(candidate) for candidate in candidates[:3]]
    about = rounds.at_rest(view, members, first_noise(view.runs))
    return Search(Data.of(about, members, candidates, (0, 1, 3), 2.0), (0, 1, 2))


def test_two_numbers_are_offered_where_either_hides_the_other():
    """Torque that is reported too large, of a load that is believed too heavy by as much: only together they tell much.
    Of a load that is lighter still each of them alone takes most of what is missed."""
    search = _searched(1.15, 1.177)
    none, together = search.score(()).log, numbers_together(search, ())
    assert together is not None
    both, log = together
    assert {search.candidate(pick).name for pick in both} == {"torque_constant", "load_inertia"}
    alone = [search.score((pick,)).log - none for pick in both]
    assert log - none > sum(alone) + HOPELESS
    assert log == pytest.approx(search.score(both).log, rel=0.02)
    assert numbers_together(_searched(0.9, 0.85), ()) is None


def test_hardly_any_inertia_with_hardly_any_torque_is_not_offered():
    """The tight spot is hardly missed then: a motor without inertia, with a fifth less torque, promised most."""
    search = _searched(0.95, 0.95)
    every = {search.candidate(pick).name: pick for pick in numbers_beside(search, ())}
    null, both = (
        search.score((every["torque_constant"], every["motor_inertia"])),
        numbers_together(search, ()),
    )
    assert both is None or null.log > both[1] + HOPELESS


def test_friction_is_on_either_side_of_the_coupling(data):
    """Each of the three has one on the other side, by its name or another; what is no friction has none."""
    search = Search(data, (0, 1, 2))
    sides = {(c.name, bool(c.behind)): i for i, c in reversed(list(enumerate(data.candidates)))}
    dry, behind = sides["coulomb_friction", False], sides["load_side_friction", True]
    drag, its = sides["quadratic_drag", False], sides["quadratic_drag", True]
    cogging = sides["cogging", False]
    picks = tuple(Pick(search.first_atom(i), 1.0) for i in (drag, behind, cogging))
    found = [search.kind(one.picks) for one in across_instead(search, picks)]
    assert found == [frozenset({its, behind, cogging}), frozenset({drag, dry, cogging})]
    few = Data.of(data.about, data.members, data.candidates, (0, 1, 3), 2.0, None, frozenset({0, 1, 2, drag}))
    alone = Search(few, (0, 1, 2))
    assert across_instead(alone, (Pick(alone.first_atom(drag), 1.0),)) == []  # it is not asked for here


def test_what_a_set_grows_into_without_a_cause_is_asked_once(data, monkeypatch):
    """A refined shape made a set likelier: everything was grown again from what it is without each of its causes."""
    search, grown, added_by_one = Search(data, (0, 1, 2)), [], offers._added

    def added(of, start, without=frozenset()):
        grown.append((of.kind(start.picks), without))
        return added_by_one(of, start, without)

    monkeypatch.setattr(offers, "_added", added)
    spot = offers.searched(search, ())
    assert list(map(search.name, spot.picks)) == ["local_friction"]
    before = len(grown)
    monkeypatch.setattr(search, "shaped", lambda one, _: replace(one, log=min(one.log + 1.0, spot.log + 2.5)))
    offers.searched(search, spot.picks)
    own = search.kind(spot.picks)
    assert grown[before:] == [(own, frozenset()), (frozenset(), own)]


@pytest.mark.parametrize("side", ["on_motor", "on_load", "position", "speed"])
def test_a_column_is_what_the_filter_makes_of_its_cause(view, side):
    noise, along = first_noise(view.runs), view.alongs(())[0]
    size = {"on_motor": 0.1, "on_load": 0.1, "position": 1e-5, "speed": 1e-2}[side]
    acts = size * np.sin(2 * np.pi * np.outer(along.time_s, [5.0, 13.0, 23.0]))
    plain = Passed.of(*equations_of(along, Acting(), noise), noise, view.runs[0])
    column = plain.whitened([Effect(**{side: acts[:, :1]}), Effect(**{side: acts[:, 1:]})])
    for i in range(3):
        pushed = Passed.of(*equations_of(along, Acting(**{side: acts[:, i]}), noise), noise, view.runs[0])
        change = plain.innovations - pushed.innovations
        # between samples a column's torque is straight, the equations' load is bent: (ωh)²/12 at 23 Hz and 1 kHz
        np.testing.assert_allclose(column[i], change, atol=2e-3 * np.max(np.abs(change)))


def test_columns_do_not_depend_on_what_they_are_whitened_with(view):
    """A few of one kind and another go together, many of one kind by themselves."""
    noise, chance = first_noise(view.runs), np.random.default_rng(2)
    sides = ["on_motor", "speed", "position", "on_load", "on_motor", "on_motor", "speed", "speed", "on_load"]
    sizes = [1, 1, 2, 1, 2, 20, 1, 9, 25]
    passed = Passed.of(*equations_of(view.alongs(())[0], Acting(), noise), noise, view.runs[0])
    count = passed.samples // 2
    effects = [
        Effect(**{side: chance.standard_normal((count, size))})
        for side, size in zip(sides, sizes, strict=True)
    ]
    effects.append(
        Effect(on_motor=chance.standard_normal((count, 1)), on_load=chance.standard_normal((count, 1)))
    )
    alone = np.concatenate([passed.whitened([effect]) for effect in effects])
    together = passed.whitened(effects)
    np.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-9 * np.max(np.abs(alone)))
    assert np.all(np.any(together, axis=1))


def test_products_are_those_of_the_columns_whenever_they_met(data):
    which = np.concatenate([np.arange(4), np.arange(40, 60), [data.width - 1]])
    rows, columns = data.rows[which].astype(float), data.rows[: data.width].astype(float)
    np.testing.assert_allclose(data.at(which).gram, rows @ rows.T / 2.0, rtol=1e-9)
    np.testing.assert_allclose(data.at(which).slope, rows @ data.target / 2.0, rtol=1e-9)
    deviations = np.ones(which.size)
    every = data.beyond(which, deviations)
    np.testing.assert_allclose(every.data.gram[which], rows @ columns.T / 2.0, rtol=1e-9, atol=1e-9)


def test_what_acts_in_some_runs_alone_has_no_products_in_others(data, view):
    """Of a curve of its own for each motion, the runs of all others were worked out as well: nothing, at length."""
    which = np.concatenate([np.arange(4), np.arange(40, 60)])
    curve = _curve(view.recorded, [0, 3], 1.0)
    everywhere, own = data.beside(which, [(curve, ())]), data.beside(which, [(curve, ())], [0, 3])
    for one, other in zip(everywhere, own, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9 * np.max(np.abs(one)))
    assert np.any(own[2])


def test_memory_that_is_full_grows(data):
    before, room = data.width, data.rows.shape[0]
    index = next(i for i, c in enumerate(data.candidates) if c.name == "position")
    while data.width <= room:
        atom = data.append(index, (), 0.0)
    first = next(atom for atom in data.atoms if atom.candidate == index)
    both = np.array([first.where.start, atom.where.start])
    gram = data.at(both).gram
    assert data.width > room > before
    assert gram[0, 1] == pytest.approx(gram[0, 0])


def test_what_is_tempered_has_later_columns_of_its_own(data):
    """Both are about the same rows: what the one asked for later was overwritten by what the other did."""
    index = next(i for i, c in enumerate(data.candidates) if c.name == "local_friction")
    other = data.tempered(4.0)
    last = data.candidates[index].shapes[0][2]
    shapes = [(place, 0.3, last) for place in (1.0, 2.0, 2.5, 1.5)]
    asked = [
        (one, one.append(index, shape, 0.0)) for shape, one in zip(shapes, [data, other] * 2, strict=True)
    ]
    for shape, (one, atom) in zip(shapes, asked, strict=True):
        rows = data.about.whitened([(data.candidates[index], shape)], data.train).copy()
        np.testing.assert_allclose(one.rows[atom.where], rows, rtol=1e-6, atol=1e-30)
        both = np.append(np.arange(3), np.arange(atom.where.start, atom.where.stop))
        np.testing.assert_allclose(one.at(both).gram[3:, :3], rows @ one.rows[:3].T / one.excess, rtol=1e-5)


def test_what_was_forgotten_is_not_remembered_by_fewer_samples(data):
    """To size a curve its set is scored without it: a search that its time had ended told what it had forgotten there,
    as if it had been at rest, or failed (KeyError)."""
    numbers = {c.name: i for i, c in enumerate(data.candidates)}
    law, curve = numbers["coulomb_friction"], numbers["position"]
    search = Search(data, (0, 1, 2))
    first = [next(i for i, a in enumerate(data.atoms) if a.candidate == index) for index in (law, curve)]
    both = search.sized(search.score((Pick(first[0], 1.0), Pick(first[1], 1.0))))
    assert frozenset([law]) in search.table
    search.table = {search.kind(both.picks): both}
    assert set(search.tempered(2.0).table) == set(search.table)


def test_a_rival_says_a_curve_by_as_few_numbers_as_the_likeliest(data):
    """Of 17 times fewer samples a load's torque was told by twelve numbers beside dry friction, and by the 39 it was
    found by beside one that differs by direction: 17 nats between what nothing tells apart."""
    dry, apart = (
        next(i for i, c in enumerate(data.candidates) if c.name == name)
        for name in ("coulomb_friction", "asymmetric_friction")
    )
    few, many = sorted(
        (i for i, c in enumerate(data.candidates) if c.name == "load_torque" and c.size > 2),
        key=lambda i: data.candidates[i].size,
    )
    search = Search(data, (0, 1, 2))
    for one, other in ((dry, few), (dry, many), (apart, many)):
        search.score((Pick(search.first_atom(one), 1.0), Pick(search.first_atom(other), 0.1)))
    fewer = search.tempered(30.0)
    _, likeliest = fewer.shares()[0]
    assert search.kind(likeliest.picks) == {dry, few}
    rival = fewer.table[frozenset({apart, few})]
    assert rival.log > fewer.table[frozenset({apart, many})].log
    assert frozenset({apart, few}) in search.table  # so that it can be brought to rest


def test_a_refined_shape_is_better_than_its_neighbours(data):
    index, candidate = next((i, c) for i, c in enumerate(data.candidates) if c.name == "local_friction")
    usual = [
        c.deviations for c in data.candidates if c.name.startswith("usual")
    ]  # their columns are the first
    deviations = np.concatenate(usual)
    members = np.arange(deviations.size)
    near = min(
        (atom for atom in data.atoms if atom.candidate == index),
        key=lambda atom: abs(atom.shape[0] - 1.9) + abs(atom.shape[1] - 0.4),
    )
    better = refined(data, near, members, deviations, 1.0)
    assert better is not None
    assert better.shape[0] == pytest.approx(2.0, abs=0.02)

    def height(shape):
        atom = data.append(index, shape, 0.0)
        which = np.append(members, atom.where.start)
        return weigh_columns(data.at(which), np.append(deviations, candidate.deviations)).log_evidence

    top = height(better.shape)
    for axis in range(2):
        for way in (-2.0, 2.0):
            moved = list(better.shape)
            moved[axis] += way * better.spread[axis]
            assert height(tuple(moved)) == pytest.approx(top - 2.0, abs=1.6)


def test_a_shape_is_known_as_well_as_its_evidence_is_sharp(data):
    """Beside all that its set leaves open, and however the shape was found: this one has no deviation of its own."""
    index = next(i for i, c in enumerate(data.candidates) if c.name == "local_friction")
    search = Search(data, (0, 1, 2))
    near = next(
        i for i, atom in enumerate(data.atoms) if atom.candidate == index and abs(atom.shape[0] - 2) < 0.2
    )
    best = search.shaped(search.score((Pick(near, 1.0),)), 0)
    shape = data.atoms[best.picks[0].atom].shape
    plain = data.append(index, shape, 0.0)
    scored = search.score((Pick(data.atoms.index(plain), 1.0),))
    found = covariance_of(search, scored, scored.picks[0])
    assert found.shape == (4, 4)

    offsets = np.linspace(-4.5, 4.5, 7)
    logs = []
    steps = np.sqrt(np.diag(found))[1:]
    for a in offsets:
        for b in offsets:
            for c in offsets:
                moved = data.append(index, tuple(np.array(shape) + np.array([a, b, c]) * steps / 2), 0.0)
                logs.append(search.score((Pick(data.atoms.index(moved), 1.0),)).log)
    weights = np.exp(np.array(logs) - max(logs)).reshape((offsets.size,) * 3)
    for axis, deviation in enumerate(steps):
        share = weights.sum(axis=tuple(i for i in range(3) if i != axis)) / weights.sum()
        spread = np.sqrt(share @ offsets**2 - (share @ offsets) ** 2) / 2
        assert spread == pytest.approx(1.0, abs=0.3), (axis, deviation)


def test_work_is_counted_and_ends_the_search(monkeypatch):
    stranger = STRANGERS[0]
    work = Work()
    assert not work.spent
    work.add(2 * work.most)
    assert work.spent
    monkeypatch.setattr(Work, "spent", property(lambda self: self.done > 0))
    found = weigh(session_of(stranger, 5, every=16, times=(0.25,)), belief_of(stranger))
    assert any("before all was tried" in note for note in found.notes)
    assert found.excess >= 1


def test_what_only_promised_has_no_more_together_than_what_was_asked(data):
    """Where no work is left to bring it to rest: else a name would be sure for what was not asked in its place."""
    search = Search(data, (0, 1, 2))
    for name in ("coulomb_friction", "local_friction", "torque_constant", "load_inertia"):
        index = next(i for i, one in enumerate(data.candidates) if one.name == name)
        search.score((Pick(search.first_atom(index), 1.0),))
    start = sorted(search.table.values(), key=lambda one: one.log)[
        1
    ]  # three of them promise more, or as much
    beyond = sum(one.log > start.log for one in search.table.values())
    assert beyond == 2
    assert next(share for share, one in search.shares() if one is start) < 0.3
    search.resting = search.kind(start.picks)
    search.doubt(start)
    shares = {search.kind(one.picks): share for share, one in search.shares()}
    own = shares.pop(search.kind(start.picks))
    assert own == pytest.approx(0.5, abs=0.01)
    assert sorted(shares.values())[1:] == pytest.approx([0.25, 0.25], abs=0.01)


def test_what_may_stand_in_the_place_of_a_name_is_asked_first(data):
    """One cause for one, and none beside it."""
    search = Search(data, (0, 1, 2))
    index = next(i for i, c in enumerate(data.candidates) if c.name == "torque_constant")
    best = search.with_pick((), Pick(search.first_atom(index), 1.0))
    before = set(search.table)
    instead_of_each(search, best)
    instead = set(search.table) - before - {frozenset()}
    assert len(instead) > 1
    assert all(len(kind) == 1 and index not in kind for kind in instead)


def test_noise_is_what_repeats_do_not_share(view):
    """Without the tight spot the equations are far off, the same in both references; the torque's noise is 0.05 N·m."""
    start, runs = first_noise(view.runs), view.runs[:2]
    systems = [equations_of(along, Acting(), start)[0] for along in view.alongs(())[:2]]
    shared = likely_noise(systems, runs, start, 1.0, 4.3)
    unshared = likely_noise(systems, runs, start, 1.0, 4.3, repeats=[(0, 1)])
    assert shared.torque_nm > 0.12
    assert unshared.torque_nm == pytest.approx(0.05, rel=0.35)


def test_what_acts_between_the_shafts_has_a_torque_too(view, data):
    """Of a stiffness: it is the same on both, and nothing of the whole."""
    about = rounds.at_rest(view, data.members, first_noise(view.runs))
    data = Data.of(about, data.members, data.candidates, (0, 1, 3), 2.0)
    search = Search(data, (0, 1, 2))
    number = next(
        i for i, atom in enumerate(data.atoms) if data.candidates[atom.candidate].name == "coupling_stiffness"
    )
    scored = search.score((Pick(number, 1.0),))
    (where,) = slices(search, scored)
    wound = np.concatenate([along.twist for along in data.about.alongs]) * scored.found.coefficients[where]
    assert np.any(wound != 0.0)
    assert _rms(search, "coupling_stiffness") == pytest.approx(np.sqrt(np.mean(wound**2)), rel=0.02)

    def between(name):
        candidate = next(c for c in data.candidates if c.name == name)
        coefficients = np.full(candidate.size, 1e-3)
        return Acts(name, candidate, candidate.shapes[0], coefficients).between_shafts(data.about.alongs[0])

    assert between("coupling_stiffness")
    assert between("kinematic_error")  # but for the ratio that it drives by
    assert not between("coulomb_friction")
    assert not between("load_side_friction")


def test_a_run_kept_aside_is_missed_by_no_more_than_noise():
    """From the recording to the states in as many steps as it takes: after one, the shaft is not wound up yet."""
    session, machine = session_of(STRANGERS[0], 5, every=8, times=(0.2,)), belief_of(STRANGERS[0])
    runs = tuple(signals_of(run, machine, 160.0, 0.0) for run in session.runs)
    of = ranges_of(list(runs), 0.002, 160.0)
    torques = tuple(TrueTorque(run, run.drive.smooth_nm) for run in runs)
    view = rounds.View(session.runs, runs, known(machine, of.low_rad, of.high_rad), of, torques, dry_nm=0.0)
    noise = first_noise(runs)
    settled = rounds.at_rest(view, (), noise)
    smoothed = rounds.linearised(rounds.resmoothed(settled.view, (), noise), (), noise, None)
    assert smoothed.square((0, 1)) == pytest.approx(settled.square((0, 1)), abs=1.0)
    aside = rounds.linearised(view, (), noise, None, (0,)).beside((1,))
    assert aside.square((1,)) == pytest.approx(settled.square((1,)), abs=1.0)


def test_fewer_samples_tell_sets_less_apart(data):
    fewer = data.tempered(4.0)
    which = np.arange(3, 9)
    np.testing.assert_allclose(fewer.at(which).gram, data.at(which).gram / 4.0)
    assert fewer.at(which).square == pytest.approx(data.at(which).square / 4.0)


def test_a_surface_varies_as_the_product_of_its_curves():
    one, other = Curve.over(0.0, 2.0, 0.3), Curve.over(-1.0, 1.0, 0.5)
    surface = Plane.of(one, other)
    x, y = np.array([0.1, 0.7, 1.9]), np.array([-0.8, 0.0, 0.4])
    rows, each = surface.at(x, y), (one.at(x), other.at(y))
    whole = (each[0] @ each[0].T) * (each[1] @ each[1].T)
    np.testing.assert_allclose(rows @ rows.T, whole, atol=0.1)
    assert surface.size < one.size * other.size / 4


def test_the_usual_timing_of_a_torque_is_any_small_delay(data):
    where, delay = data.about.alongs[0], 1e-4
    timing = next(c for c in data.candidates if c.name == "usual_torque_timing")
    smooth = where.run.quiet(where.torque)
    wanted = CubicSpline(where.time_s, smooth)(where.time_s + delay) - smooth
    columns = where.run.quiet(timing.effect(where, ()).on_motor)
    rest = [np.std((wanted - columns @ [delay, bend])[100:-100]) for bend in (delay**2 / 2, 0.0)]
    assert rest[0] < 0.2 * rest[1]


@pytest.mark.parametrize("side", ["on_motor", "on_load"])
def test_friction_leaves_rest_open_whichever_curve_carries_it(view, side):
    """Found with all that is smooth present, a surface over angle and speed had it: dry friction was no law then."""
    friction = Candidate("surface", lambda a, _: Effect(**{side: -a.direction[:, None]}), (1.0,))
    swings = Candidate("curve", lambda a, _: Effect(on_load=a.load_acceleration[:, None]), (1.0,))
    along = view.alongs(())[0]
    swing = 2.0 / np.max(np.abs(along.load_acceleration))
    members = [Member(c, (), np.array([by]), np.ones(1)) for c, by in ((friction, 0.7), (swings, swing))]
    assert rounds.acting(view, along, members).dry_nm == pytest.approx(0.7, rel=0.1)
    assert rounds.acting(view, along, members[1:]).dry_nm < 0.1


def test_a_set_is_settled_from_what_its_laws_would_be_without_errors(data):
    """Beside the errors' columns coefficients are others: as a step for the laws alone they led nowhere."""
    search = Search(data, (0, 1, 2))
    scored = max(offered(search, ()), key=lambda one: one.log)
    exact = scored.which[: scored.exact.size]
    assert scored.which.size > exact.size
    alone = weigh_columns(data.at(exact), scored.deviations[: exact.size]).coefficients
    assert not np.allclose(scored.found.coefficients[: exact.size], alone, rtol=1e-9, atol=0.0)
    members = members_of(search, scored, data.candidates)
    np.testing.assert_allclose(np.concatenate([m.coefficients for m in members]), alone, rtol=1e-9)


def test_what_was_not_kept_is_not_promised_by_more_of_the_same(data):
    search = Search(data, (0, 1, 2), resting=frozenset({10}))
    search.kept = {frozenset({10, 11}): -8.0, frozenset({12}): -3.0}
    assert search.unkept(frozenset({10, 11})) == -8.0
    assert search.unkept(frozenset({11, 12, 13})) == -8.0
    assert search.unkept(frozenset({12, 14})) == -3.0
    assert search.unkept(frozenset({10, 14})) == -3.0  # no better than the best of those that were tried
    assert search.unkept(frozenset({10})) == 0.0
    search.kept[frozenset({13})] = -np.inf  # it came to nothing, and says so of no other
    assert search.unkept(frozenset({13, 15})) == -np.inf
    # what promised nothing and came to nothing: of no share was anything known, so that nothing was told of a file
    search.note(frozenset({16}), -np.inf, -np.inf)
    assert search.unkept(frozenset({16})) == 0.0
    search.note(frozenset({16}), -np.inf, 5.0)
    assert search.unkept(frozenset({16})) == -np.inf
    assert search.unkept(frozenset({14})) == -3.0
    search.kept = {frozenset({13}): -np.inf}
    assert search.unkept(frozenset({14})) == 0.0


def test_one_cause_in_place_of_two_is_looked_at(data):
    """A load inertia and a stiffness stood for a further mass: without either, no other one was likelier."""
    search = Search(data, (0, 1, 2))
    index = {c.name: i for i, c in enumerate(data.candidates)}
    two = [Pick(search.first_atom(index[name]), 1.0) for name in ("coulomb_friction", "viscous_friction")]
    _neighbours(search, search.score(tuple(two)))
    assert frozenset({index["local_friction"]}) in search.table


@pytest.mark.parametrize("runs_away", [np.nan, 1e4])
def test_states_that_run_away_stay_where_the_runs_were_likeliest(view, monkeypatch, runs_away):
    """A further mass beside a wrong inertia shook itself up: noise was taken for 10⁵ N·m, and nothing was found."""
    smoothed, seen = rounds.resmoothed_about, []

    def shaken(about):
        further = smoothed(about)
        seen.append(about.square(range(len(view.runs))))
        if len(seen) < 2:
            return further
        runs = (run.about(run.states * runs_away) for run in further.runs)
        return replace(further, runs=tuple(runs))

    monkeypatch.setattr(rounds, "resmoothed_about", shaken)
    found = rounds.at_rest(view, (), first_noise(view.runs))
    assert len(seen) >= 2
    assert found.square(range(len(view.runs))) == pytest.approx(min(seen))


def test_each_law_that_bends_the_coupling_is_offered_in_anothers_place(view, data):
    """Beside hysteresis, which promised more, a cubic stiffness had no room; and a stiffness, which it is in its limit,
    was not asked for."""
    about = rounds.at_rest(view, data.members, first_noise(view.runs))
    search = Search(Data.of(about, data.members, data.candidates, (0, 1, 3), 2.0), (0, 1, 2))

    def pick(name):
        return next(
            Pick(i, 1.0) for i, a in enumerate(search.data.atoms) if search.name(Pick(i, 1.0)) == name
        )

    spot, last = pick("local_friction"), pick("coupling_hysteresis")
    instead = [one.picks for one in bending_instead(search, (spot, last))]
    assert {search.name(picks[-1]) for picks in instead} == {
        *("nonlinear_stiffness", "stiffness_over_angle", "coupling_stiffness")
    }
    assert all(picks[0] == spot for picks in instead)
    assert bending_instead(search, (last, spot)) == []
    assert search.prior((spot, last)) - search.prior((spot,)) == pytest.approx(
        2 * search.handicap + search.data.candidates[search.index(last)].shape_log
    )  # it is one law and something more


@pytest.mark.parametrize("share", [1.0, 0.5, -1.0])
def test_what_a_name_takes_with_its_own_numbers_is_the_change_of_what_is_missed(data, share):
    search = Search(data, (0, 1, 2))
    friction = next(pick for _, pick in search.additions(()) if search.name(pick) == "viscous_friction")
    best = search.score((friction,))
    where = data.atoms[friction.atom].where
    told = best.found.coefficients.copy()
    own = np.flatnonzero((best.which >= where.start) & (best.which < where.stop))
    usual = np.arange(sum(data.candidates[i].size for i in (0, 1, 2)))
    assert set(best.which) == {*best.which[usual], *best.which[own]}  # it has no errors of its law
    told[own] *= share
    scored = replace(best, found=replace(best.found, coefficients=told))
    before = data.target - told[usual] @ data.rows[best.which[usual]]
    after = before - told[own] @ data.rows[best.which[own]]
    expected = (before @ before - after @ after) / 2 / 2.0
    assert taken_as_told(search, scored, (friction,), friction) == pytest.approx(expected, rel=1e-6)
