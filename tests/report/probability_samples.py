"""An answer of weighing, made by hand."""

from __future__ import annotations

import numpy as np

from schwung.drivetrain import paper_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.values import Quantity
from schwung.explain.weighing.drawn import Drawn
from schwung.explain.weighing.publication import Before, Curve, Name, Published
from schwung.explain.weighing.values import Proof
from schwung.innovations.likelihood import Noise

X, TIME = np.linspace(0.0, 20.0, 21), np.arange(400) / 1000
TERMS = (
    PhysicsTerm.model_validate({"name": "torque_offset", "torque_nm": 2.0, "probability": 0.98}),
    PhysicsTerm.model_validate(
        {"name": "residual", "coordinate": "speed", "table": np.stack([X, -0.3 * X, 0.3 * X], 1).tolist()}
    ),
)


def answer() -> Published:
    """An offset with a name, a curve over speed without one, and a rival."""
    drawn = Drawn("speed", X, -0.3 * X, 0.1 + 0 * X, 0.3 * X, 0.1 + 0 * X)
    return Published(
        axis="rotary",
        effort="torque",
        names=(
            Name("torque_offset", 0.98, {"torque_nm": Quantity(2.0, "N·m", (1.9, 2.1))}, True),
            Name("backlash", 0.2, {"gap_rad": Quantity(1e-4, "rad", (0.0, 2e-4))}, False),
        ),
        curves=(Curve("speed", "rad/s", 0.999, 1.7, "", True, drawn, "(−0.3·|ω|)·sign ω", 1.01),),
        runners_up=((("speed", "torque_offset"), 0.8), (("backlash",), 0.2)),
        noise=Noise(0.3, 0.01, 1e-5),
        excess=1.6,
        proof=Proof((3, 5), 4.0, 6.0, 1.01),
        shown=(Before(3, TIME, 3 * np.sin(20 * TIME), 0.2 * np.cos(90 * TIME)),),
        machine=paper_machine().model_copy(update={"physics": TERMS}),
        notes=("the <first> note",),
    )
