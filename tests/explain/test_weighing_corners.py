"""A drive holds its torque from tick to tick, and reads the speed in the corner: no coupling is softer for that."""

from dataclasses import replace

import numpy as np
import pytest
from stranger_plant import Stranger, draw_stranger, stranger_belief, stranger_session

from schwung.drivetrain import InertiaTable
from schwung.drivetrain.machine import Load, Machine
from schwung.explain.weighing.weigh import weigh
from schwung.session import Session


def known_inertia(stranger: Stranger) -> Machine:
    angles = np.linspace(-1.0, stranger.stroke_rad + 1.0, 4001)
    table = InertiaTable(angles, stranger.truth(angles))
    load = Load(viscous_friction_nms=stranger.shaft.load_viscous, inertia_table=table)
    return stranger_belief(stranger).model_copy(update={"load": load})


@pytest.mark.long
def test_a_sound_coupling_near_whose_resonance_is_injected_has_no_name():
    """At 69 Hz, of 93 Hz, the corner's speed is half a per cent of the swing: as of a stiffness 0.34 % off."""
    stranger, runs = draw_stranger(111), []
    for number, times in enumerate((1.0, 1.6)):
        slower = replace(stranger, duration_s=times * stranger.duration_s)
        runs += stranger_session(slower, 1110 + number).runs
    session = Session(tuple(runs), created="2026-01-01T00:00:00", source="stranger")
    found = weigh(session, known_inertia(stranger))
    assert all(one.probability < 0.5 for one in found.names), found.names
