"""What is said beside names: inertia and torque constant in each other's place, and what to measure first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from probability_samples import answer

from schwung.drivetrain import Machine, paper_machine
from schwung.explain.causes.along import Ranges
from schwung.explain.publishing.advice import advice
from schwung.explain.publishing.values import Name, Proof, Published
from schwung.explain.values import Quantity

RANGES = Ranges(0.0, 3.0, 20.0, 2e3, 100.0, 0.5, 0.04, 4, 160.0)


def named(name: str, other: str, **values: float) -> Published:
    """One name in the file, and one that might stand in its place."""
    parameters = {key: Quantity(value, "", None) for key, value in values.items()}
    sets = (((name,), 0.6), ((other,), 0.4))
    return replace(answer(), names=(Name(name, 0.6, parameters, True),), curves=(), runners_up=sets)


def constant() -> Machine:
    """A load that is believed to be alike at all angles."""
    load = paper_machine().load.model_copy(update={"inertia_table": None, "inertia_kgm2": 0.1})
    return paper_machine().model_copy(update={"load": load})


def test_an_inertia_that_may_be_a_torque_constant_scales_every_torque() -> None:
    machine = constant()
    scale = 1.2
    found = named("load_inertia", "torque_constant", scale=scale, delta_kgm2=0.0)
    (told,) = advice(found, machine, RANGES)
    motor = machine.motor.inertia_kgm2
    factor = float(told.rpartition(" ")[2])
    # the same reported torque accelerates the believed inertia, if it truly is that much less
    np.testing.assert_allclose(factor * (motor + scale * 0.1), motor + 0.1, rtol=2e-3)
    assert not [*advice(replace(found, runners_up=(found.runners_up[0],)), machine, RANGES)]
    assert not [*advice(named("load_inertia", "backlash", scale=scale), machine, RANGES)]


def test_a_torque_constant_that_may_be_an_inertia_says_what_divides() -> None:
    (told,) = advice(named("torque_constant", "load_inertia", gain=0.93), paper_machine(), RANGES)
    assert told.endswith("divided by 0.93")


def test_a_constant_inertia_is_to_be_measured_first_where_nothing_explains() -> None:
    lost = replace(answer(), names=(), curves=(), runners_up=(), proof=Proof((3,), 0.0, 8.0, 8.0))
    (told,) = advice(lost, constant(), RANGES)
    assert "measure it first" in told
    table = paper_machine()
    assert table.load.inertia_table is not None
    assert not [*advice(lost, table, RANGES)]
    assert not [*advice(answer(), constant(), RANGES)]


def test_a_further_mass_that_the_load_lacks_is_a_part_of_it() -> None:
    """A stator on a base of 18 Hz: a further mass of 0.001357 kg·m², and a load lighter by 0.001358, as it is not."""
    mass = Name("extra_compliance", 1.0, {"inertia_kgm2": Quantity(0.001357, "", (0.00133, 0.00139))}, True)

    def beside(delta: float) -> Published:
        load = Name(
            "load_inertia", 1.0, {"delta_kgm2": Quantity(delta, "", (delta - 3e-5, delta + 3e-5))}, True
        )
        return replace(answer(), names=(mass, load), curves=(), runners_up=())

    (told,) = advice(beside(-0.001358), paper_machine(), RANGES)
    assert "as heavy as believed" in told
    assert not [*advice(beside(-0.001), paper_machine(), RANGES)]
    assert not [*advice(replace(answer(), names=(mass,), curves=()), paper_machine(), RANGES)]
