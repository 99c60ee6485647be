"""The vocabulary: every cause that has a name, the discrepancies that have none, and what every drive does."""

from __future__ import annotations

import numpy as np

from schwung.explain.causes.along import Ranges
from schwung.explain.causes.candidate import NATURAL, Candidate
from schwung.explain.causes.known import Known
from schwung.explain.causes.vocabulary.friction import friction
from schwung.explain.causes.vocabulary.hysteresis import hysteresis
from schwung.explain.causes.vocabulary.load import load, table_error
from schwung.explain.causes.vocabulary.periodic import periodic
from schwung.explain.causes.vocabulary.presliding import presliding
from schwung.explain.causes.vocabulary.reporting import TICK_S, reporting, usual
from schwung.explain.causes.vocabulary.shaft import shaft
from schwung.explain.causes.vocabulary.unnamed import unnamed

__all__ = ["vocabulary"]


def vocabulary(of: Ranges, believed: Known) -> list[Candidate]:
    """Every candidate of a machine over these ranges; what is always there comes first."""
    machine = believed.machine
    inertia = machine.load_inertia_at(np.linspace(of.low_rad, of.high_rad, 65))
    mean, natural = float(np.mean(inertia)), NATURAL * of.peak_torque_nm
    found = [
        *usual(TICK_S if machine.control is None else 1 / machine.control.sample_rate_hz),
        *table_error(of, machine),
        *friction(of, natural, machine.coupling is None, believed),
        presliding(of, natural, believed),
        *load(of, natural, machine),
        *periodic(of, natural),
        *reporting(of, NATURAL),
    ]
    if machine.coupling is not None:
        found += shaft(of, machine.coupling, natural, machine.motor.inertia_kgm2, mean)
        found.append(hysteresis(of, machine.coupling, natural, believed))
    return found + unnamed(of, natural)
