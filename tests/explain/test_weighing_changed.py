"""A machine that is heavier than when its inertia was measured: the belief's own errors do not take that."""

import numpy as np
from strangers import LOAD, LOAD_VISCOUS, Stranger, belief_of, session_of

from schwung.drivetrain import Load
from schwung.drivetrain.inertia import InertiaTable
from schwung.explain.weighing.published import publish

HEAVIER = 0.15


def test_what_was_measured_before_it_changed_is_off_by_more_than_its_errors() -> None:
    stranger = Stranger("heavier", ("load_inertia",), believed_scale=1 / (1 + HEAVIER))
    session = session_of(stranger, 5, every=8, times=(0.25, 0.4))
    measured = LOAD / (1 + HEAVIER) * (1 + 0.005 * np.random.default_rng(7).standard_normal(64))
    table = InertiaTable(np.linspace(-0.5, 4.0, 64), measured, np.full(64, 0.005 * LOAD))
    machine = belief_of(stranger).model_copy(
        update={"load": Load(viscous_friction_nms=LOAD_VISCOUS, inertia_table=table)}
    )
    found = publish(session, machine)
    (name,) = (one for one in found.names if one.probability > 0.5)
    assert name.physics == "load_inertia"
    assert name.in_file
    assert found.proof is not None
    assert found.proof.before > 2 * found.proof.after
