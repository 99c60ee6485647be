"""A machine that is heavier than when its inertia was measured: the belief's own errors do not take that."""

import numpy as np
import pytest
from strangers import LOAD, LOAD_VISCOUS, Stranger, belief_of, session_of

from schwung.drivetrain import Load
from schwung.drivetrain.inertia import InertiaTable
from schwung.explain.publishing.publish import publish
from schwung.explain.publishing.values import Published

SCATTER = 0.005


def weighed(heavier: float) -> Published:
    """Against a measured table that scatters as it says, of a machine that was so much lighter (a share) then."""
    stranger = Stranger("heavier", ("load_inertia",), believed_scale=1 / (1 + heavier))
    measured = LOAD / (1 + heavier) * (1 + SCATTER * np.random.default_rng(8).standard_normal(64))
    table = InertiaTable(np.linspace(-0.5, 4.0, 64), measured, np.full(64, SCATTER * LOAD))
    load = Load(viscous_friction_nms=LOAD_VISCOUS, inertia_table=table)
    session = session_of(stranger, 5, every=8, times=(0.25, 0.4))
    return publish(session, belief_of(stranger).model_copy(update={"load": load}))


@pytest.mark.long
def test_what_was_measured_before_it_changed_is_off_by_more_than_its_errors() -> None:
    found = weighed(heavier=0.15)
    (name,) = (one for one in found.names if one.probability > 0.5)
    assert name.physics == "load_inertia"
    assert name.in_file
    assert found.proof is not None
    assert found.proof.before > 2
    assert found.proof.after < 1.1


@pytest.mark.long
def test_what_has_not_changed_is_off_by_its_errors_alone() -> None:
    found = weighed(heavier=0.0)
    assert found.verdict == "consistent"
    assert found.proof is not None
    assert found.proof.before < 1.1
