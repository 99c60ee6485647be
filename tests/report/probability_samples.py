"""An answer of weighing, made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.drivetrain import paper_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.publishing.drawn import Drawn
from schwung.explain.publishing.values import Curve, Name, Proof, Published, Where
from schwung.explain.values import Located, Overlay, Quantity
from schwung.explain.weighing.values import Parameter, Timing
from schwung.innovations.likelihood import Noise

X, TIME = np.linspace(0.0, 20.0, 21), np.arange(400) / 1000
TERMS = (
    PhysicsTerm.model_validate({"name": "torque_offset", "torque_nm": 2.0, "probability": 0.98}),
    PhysicsTerm.model_validate(
        {"name": "residual", "coordinate": "speed", "table": np.stack([X, -0.3 * X, 0.3 * X], 1).tolist()}
    ),
)


WAVE = np.sin(20 * TIME)
RUN = Overlay(
    run=3, heldout=True, time_s=TIME, position_rad=-WAVE / 20, speed_rad_s=20 * np.cos(20 * TIME),
    acceleration_rad_s2=-400 * WAVE, torque_nm=9 * WAVE, before_nm=6 * WAVE,
    after_nm=9 * WAVE - 0.2 * np.cos(90 * TIME), terms_nm={"torque_offset": np.full(TIME.size, 2.0)},
    considered=TIME > 0.02, motion_time_s=TIME,
)  # fmt: skip
MISSED = Located("position", (-0.05, 0.05), "rad", 0.7, 0.001, "Over the whole range of position, 70 %.")


def answer() -> Published:
    """An offset with a name, a curve over speed without one, and a rival."""
    drawn = Drawn("speed", X, -0.3 * X, 0.1 + 0 * X, 0.3 * X, 0.1 + 0 * X)
    return Published(
        axis="rotary",
        effort="torque",
        names=(
            Name(
                "torque_offset",
                0.98,
                {"torque_nm": Quantity(2.0, "N·m", (1.9, 2.1))},
                True,
                where=Where("position", (-0.01, 0.02), "rad", "forward", 0.4),
            ),
            Name("backlash", 0.2, {"gap_rad": Quantity(1e-4, "rad", (0.0, 2e-4))}, False),
        ),
        curves=(Curve("speed", "rad/s", 0.999, 1.7, "", True, drawn, "(−0.3·|ω|)·sign ω", 1.01),),
        runners_up=((("speed", "torque_offset"), 0.8), (("backlash",), 0.2)),
        noise=Noise(0.3, 0.01, 1e-5),
        excess=1.6,
        timing=Timing(Parameter(-8.7e-5, -8.9e-5, -8.5e-5), "speed", 7e-5),
        proof=Proof((3, 5), 4.0, 6.0, 1.01, 2.1, 0.14),
        overlays=(RUN,),
        machine=paper_machine().model_copy(update={"physics": TERMS}),
        notes=("the <first> note",),
        mismatch=(MISSED,),
        remainder=(replace(MISSED, share_of_energy=0.2),),
    )
