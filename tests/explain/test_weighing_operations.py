"""Machines that are run otherwise than a commissioning does: another plant, and ways of running it that are its own."""

from types import SimpleNamespace

import numpy as np
import pytest
from operations import OPERATIONS, belief, judged, session_of

from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.vocabulary.load import load
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.weigh import weigh

RANGES = Ranges(0.0, 4.0, 50.0, 2000.0, 40.0, 1.0, 0.1, 3, 160.0)
BELIEVED: Machine = belief()


def _payload():
    return next(c for c in load(RANGES, 4.0, BELIEVED) if c.each_run)


def _along(run: int):
    return SimpleNamespace(number=run, speed=np.ones(5), load_acceleration=np.arange(5.0))


def test_a_payload_takes_what_all_runs_share_and_what_is_the_runs_own() -> None:
    payload, found = _payload(), np.array([0.1, 0.0, 0.02, -0.03])
    for run, carried in ((0, 0.1), (1, 0.12), (2, 0.07), (7, 0.1)):
        _, on_load, _, _ = payload.done(_along(run), (), found).alone
        np.testing.assert_allclose(on_load, -carried * np.arange(5.0))
        np.testing.assert_allclose(payload.heavier(_along(run), (), found), np.full(5, carried))
    assert payload.name == "load_inertia"
    assert payload.keys(found, ()) == {"delta_kgm2": 0.1}


def test_runs_that_carry_alike_or_less_than_nothing_are_no_change_of_payload() -> None:
    """EMPS's cycles, believed 5 kg lighter, had each 89 of 75 kg less, and a torque constant that fades beside."""
    payload, mass = _payload(), BELIEVED.load_inertia_at(np.zeros(1))[0]
    assert not payload.is_another(np.array([0.0, 0.0, 0.1 * mass, 0.0]) + 1e-9, ())
    assert payload.is_another(np.array([0.1, 0.001, 0.002, 0.0]) * mass, ())
    assert payload.is_another(np.array([-0.5, -0.6, 0.2, 0.0]) * mass, ())


def test_what_a_file_cannot_say_of_a_payload_is_said_run_by_run() -> None:
    words = _payload().unsaid(np.array([1e-3, -1e-3 - 1e-9, 0.0, 2e-4]), np.ones(4), (), "N·m")
    assert words == "what each run has of it: run 0 +0.0000, run 2 +0.0012 kg·m²"


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        "a fan",
        "another payload in every other run",
        "another payload from the sixth run on",
        "an encoder of 16 bits, dry friction",
        "an encoder of 20 bits, 1 kHz, nothing hidden",
    ],
)
def test_it_is_named_as_on_a_machine_that_is_commissioned(name: str) -> None:
    """A fan was drag and a motor inertia, a payload a torque constant that fades, counts an encoder an eccentricity, a
    transmission's error and a damping, surely: friction was of the motor alone, the inertia one for all runs, a
    speed counted as if it was measured."""
    operation = next(one for one in OPERATIONS if one.name == name)
    found = publish(session_of(operation, 7), BELIEVED)
    names = {one.physics: one.probability for one in found.names}
    assert judged(operation, names) == "right", names
    assert not [one for one in found.curves if one.probability > 0.5]
    said = " ".join(found.notes)
    assert ("what each run has" in said) == ("payload" in name)
    assert ("the angle alone was asked" in said) == ("16 bits" in name)


@pytest.mark.long
@pytest.mark.parametrize("seed", [3, 5])
def test_without_an_injection_a_heavier_load_is_no_sure_motor_inertia(seed: int) -> None:
    """Of the torque's noise one set missed a hundred nats less than the other by chance, or what was compared in place
    of that still held noise: a motor inertia had 0.98 to 1.00."""
    operation = next(one for one in OPERATIONS if one.name == "no injection, load 6 % heavier")
    names = {one.name: one.probability for one in weigh(session_of(operation, seed), BELIEVED).names}
    assert judged(operation, names) == "right", names
