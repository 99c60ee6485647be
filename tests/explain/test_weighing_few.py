"""What a few runs are made of is looked for first."""

from dataclasses import replace
from pathlib import Path

import pytest
from sealed_sessions import drawn

from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.weigh import weigh


@pytest.mark.long
def test_three_causes_at_once(tmp_path: Path) -> None:
    """From nothing, all runs led to curves over position, speed and time, and no name."""
    session, machine, label = drawn(tmp_path, 294501, 2, kind="three", level="clear")
    found = publish(session, machine)
    hidden = {effect["physics"] for effect in label["effects"]}
    assert hidden == {"stribeck_friction", "cogging", "load_event"}
    assert {one.physics for one in found.names if one.probability > 0.9} == hidden
    assert not [one for one in found.curves if one.probability > 0.5]


@pytest.mark.long
@pytest.mark.parametrize("runs", [12, 4])
def test_two_laws_that_one_curve_with_a_name_does_together(runs: int, tmp_path: Path) -> None:
    """Beside another inertia over the angle neither was missed, and what the curve could not do was a ripple and a
    stiffness over the angle, with 0.96 and 0.89. Four runs are as many as a few, and looked through at once."""
    session, machine, label = drawn(tmp_path, 326002, 2, kind="two", level="clear")
    hidden = {effect["physics"] for effect in label["effects"]}
    assert hidden == {"encoder_eccentricity", "load_inertia"}
    found = weigh(replace(session, runs=session.runs[:runs]), machine)
    assert {one.name for one in found.names if one.probability > 0.5} == hidden


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "causes"),
    [
        # of a larger torque constant and a heavier load alone neither promised as much as a transmission's error did:
        # three curves over the position were told, and in more runs three wrong names
        (952044, {"coulomb_friction", "load_inertia", "torque_constant"}),
        # an event and play were known beside curves over position, speed and the inertia; laws that began from nothing
        # ended elsewhere, so that five curves were told, and no name
        (952060, {"backlash", "load_event", "quadratic_drag"}),
    ],
    ids=["two numbers that hide each other", "laws beside curves"],
)
def test_three_causes_that_curves_stood_for(seed: int, causes: set[str], tmp_path: Path) -> None:
    session, machine, label = drawn(tmp_path, seed, 2, kind="three", level="clear")
    assert {effect["physics"] for effect in label["effects"]} == causes
    found = weigh(session, machine)
    assert {one.name for one in found.names if one.probability > 0.9} == causes
    assert not [one for one in found.unnamed if one.probability > 0.1]
