"""Names beside what has none: a stranger's friction or coupling, and what everybody knows."""

from dataclasses import replace

import pytest
from sealed_sessions import fewer
from strangers import STRANGERS, belief_of, session_of

from schwung.explain.weighing.weigh import posterior_of

ROOT = next(one for one in STRANGERS if one.friction[2])  # friction over the root of the speed
SOFT = next(one for one in STRANGERS if one.yields[0])  # a coupling that bends by no law of the vocabulary


BENDS = next(one for one in STRANGERS if one.bends[0])  # friction that bends as Bouc has it before it slides
GEAR = next(one for one in STRANGERS if one.friction[3])
TRACKS = next(one for one in STRANGERS if one.tracks[0])
LOADED = replace(SOFT, friction=(0.8, 0.0, 0.0, 0.0), believed_scale=0.95)


@pytest.mark.long
@pytest.mark.parametrize(
    ("hidden", "names", "curve"),
    [
        (replace(ROOT, teeth=(0.5, 12.0, 0.0)), {"cogging"}, "speed"),
        (replace(ROOT, believed_scale=0.95), {"load_inertia"}, "speed"),
        (replace(ROOT, loop_s=4e-4), {"torque_lag"}, "speed"),
        (LOADED, {"load_inertia", "coulomb_friction"}, "wind_up"),
        (replace(TRACKS, yields=SOFT.yields), {"encoder_harmonic"}, "wind_up"),
    ],
    ids=["cogging", "load", "lag", "coupling", "encoder"],
)
def test_what_is_plain_has_its_name_beside_a_curve(hidden, names, curve):
    """All else fell beside friction that nobody has named, half a newton metre of cogging too: it had to be 50 times
    the friction's evidence. Beside laws that no coupling has, six causes and two curves made up for what they do."""
    session = fewer(session_of(hidden, 5, every=8, times=(0.25, 0.4)), 2)
    told = posterior_of(session, belief_of(hidden)).told
    assert {one.name for one in told.names if one.probability > 0.5} == names
    assert [one.coordinate for one in told.unnamed if one.probability > 0.5] == [curve]


@pytest.mark.long
def test_what_does_nearly_what_a_curve_does_is_no_name():
    """Beside Dahl and a gear, a load by direction did most of what Bouc has beyond Dahl, and had 0.74."""
    hidden = replace(BENDS, friction=GEAR.friction)
    session = fewer(session_of(hidden, 111, every=8, times=(0.25, 0.33, 0.4)), 2)
    told = posterior_of(session, belief_of(hidden)).told
    assert {one.name for one in told.names if one.probability > 0.5} == {*BENDS.right, *GEAR.right}
