"""Sets are compared by what they predict of the torque that can be heard: its noise is missed by chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from integrated import RATE_HZ, sampled, view_of
from next_experiment import Room, weighed_session
from stranger_plant import draw_hidden, stranger_belief, stranger_session

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain.causes.true_torque import TrueTorque
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.weighing.alike import misses_less
from schwung.explain.weighing.round import Linearised, View, at_rest, torques_about
from schwung.explain.weighing.sets import everything
from schwung.explain.weighing.wide import wide_fit
from schwung.innovations.likelihood import Noise, first_noise

SAMPLES = 8000
NOISE = Noise(torque_nm=0.3, speed_rad_s=0.05, position_rad=3e-6)
ROTOR, LOAD, STIFFNESS, DAMPING = 0.02, 0.06, 9000.0, 1.0
ANGLES = np.linspace(-4.0, 4.0, 4001)


def machine_of(inertia: np.ndarray, rotor: float = ROTOR) -> Machine:
    return Machine(
        name="quiet",
        motor=Motor(inertia_kgm2=rotor, viscous_friction_nms=0.05, peak_torque_nm=100.0),
        coupling=Coupling(stiffness_nm_rad=STIFFNESS, damping_nms=DAMPING),
        load=Load(inertia_table=InertiaTable(ANGLES, inertia), viscous_friction_nms=0.0),
    )


@pytest.fixture(scope="module")
def often() -> tuple[np.ndarray, np.ndarray]:
    """Angle and speed (2, 8n) of a motor whose drive makes a slow sine of torque, and that torque, eight a sample."""
    tick, count = 1 / (8 * RATE_HZ), 8 * SAMPLES
    torque = 15 * np.sin(2 * np.pi * 2.5 * tick * np.arange(count + 1))
    state, states = np.zeros(4), np.empty((count, 4))

    def rates(at: np.ndarray, acting: float) -> np.ndarray:
        motor, speed, load, load_speed = at
        carried = STIFFNESS * (motor - load) + DAMPING * (speed - load_speed)
        return np.array([speed, (acting - carried - 0.05 * speed) / ROTOR, load_speed, carried / LOAD])

    for k in range(count):
        states[k] = state
        first, middle, last = torque[k], (torque[k] + torque[k + 1]) / 2, torque[k + 1]
        one = rates(state, first)
        two = rates(state + tick / 2 * one, middle)
        three = rates(state + tick / 2 * two, middle)
        state = state + tick / 6 * (one + 2 * two + 2 * three + rates(state + tick * three, last))
    return states[:, :2].T, torque[:-1]


@pytest.fixture(scope="module")
def quietly(often: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The same at the samples."""
    moved, torque = often
    return moved[:, ::8], torque[::8]


def seen(quietly: tuple[np.ndarray, np.ndarray], machine: Machine, noise: Noise, chance: int = 0) -> View:
    """What is weighed of it, recorded with noise."""
    moved, torque = quietly
    return view_of([sampled(chance, np.arange(SAMPLES) / RATE_HZ, moved, torque, noise)], machine)


SOUND = machine_of(np.full(ANGLES.size, LOAD))


def missed(quietly: tuple[np.ndarray, np.ndarray], machine: Machine, chance: int) -> Linearised:
    view = seen(quietly, machine, NOISE, chance)
    return at_rest(replace(view, torques=(TrueTorque(view.runs[0], quietly[1]),)), [], NOISE)


def test_a_drive_that_shakes_nothing_says_nothing_of_what_swings(
    quietly: tuple[np.ndarray, np.ndarray],
) -> None:
    """Noise that goes through one machine or another is missed more or less by chance: what they predict is alike."""
    shifted = machine_of(np.full(ANGLES.size, 0.9 * LOAD), ROTOR + 0.1 * LOAD)
    plain, alike = [], []
    for chance in range(6):
        true, other = (missed(quietly, machine, chance) for machine in (SOUND, shifted))
        plain.append(other.square((0,)) - true.square((0,)))
        alike.append(misses_less(true, other, (0,)))
    assert np.std(plain) > 10
    assert np.max(np.abs(alike)) < 6


@pytest.mark.parametrize("every", [1, 2, 4], ids=lambda every: f"{every} recorded in a step")
def test_noise_of_the_torque_is_white_in_what_is_foreseen(
    often: tuple[np.ndarray, np.ndarray], every: int
) -> None:
    """A curve through noisy samples bends between them with their noise: the truth missed 1.1 to 1.2 times its noise at
    some frequencies, and machines that let less of it through were likelier."""
    moved, torque = (each[..., :: 8 // every] for each in often)
    loud, powers = replace(NOISE, torque_nm=1.0), []
    for chance in range(5):
        time = np.arange(torque.size) / (every * RATE_HZ)
        view = view_of([sampled(chance, time, moved, torque, loud, every * RATE_HZ)], SOUND)
        assert view.runs[0].drive.every == every
        torques = torques_about(at_rest(view, [], loud))
        view = replace(view, torques=tuple(replace(one, as_sampled=False) for one in torques))
        missed = at_rest(view, [], loud).innovations((0,)).reshape(-1, 2)[100:]
        powers.append(np.abs(np.fft.rfft(missed, axis=0)) ** 2 / len(missed))
    bands = np.array([np.mean(band, axis=0) for band in np.array_split(np.mean(powers, axis=0)[1:], 6)])
    assert np.all(np.abs(bands - 1) < 0.06), bands


def test_whether_it_bends_as_it_was_sampled_is_what_runs_are_likelier_with(
    quietly: tuple[np.ndarray, np.ndarray],
) -> None:
    """What a filter does not foresee is noise, or contacts that are faster than the samples: those bend the torque."""
    shaken = draw_hidden(500, every=8)
    assert shaken.cause == "play"
    contacts = view_of(stranger_session(shaken, 500).runs, stranger_belief(shaken))
    for view, as_sampled in (seen(quietly, SOUND, replace(NOISE, torque_nm=1.0)), False), (contacts, True):
        members = everything(vocabulary(view.ranges, view.known), ())
        wide = wide_fit(view, members, first_noise(view.runs), range(len(view.runs)))
        assert {torque.as_sampled for torque in wide.torques} == {as_sampled}


def test_what_is_predicted_otherwise_counts_as_before(quietly: tuple[np.ndarray, np.ndarray]) -> None:
    true, heavier = (
        missed(quietly, machine_of(np.full(ANGLES.size, inertia)), 1) for inertia in (LOAD, 1.003 * LOAD)
    )
    plain = heavier.square((0,)) - true.square((0,))
    assert plain > 40
    assert misses_less(true, heavier, (0,)) == pytest.approx(plain, rel=0.1)
    assert misses_less(heavier, true, (0,)) == pytest.approx(-misses_less(true, heavier, (0,)))


@pytest.mark.long
def test_a_load_that_is_3_percent_off_is_no_further_mass_at_its_resonance() -> None:
    """One careful stroke: a further mass missed twenty nats less of the torque's noise, and had 1.00."""
    room = Room.drawn_by(72008)
    assert room is not None
    runs = [run for _ in range(2) for run in room.record(room.setting.done)]
    names = {one.name for one in weighed_session(runs, room).told.names if one.probability > 0.5}
    assert names == {"load_inertia"}
