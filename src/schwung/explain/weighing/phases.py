"""The phase of a known periodic disturbance in each run: nothing that a motion sets off, so that each has its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.vocabulary.periodic import waves
from schwung.explain.weighing.round import View, at_rest
from schwung.innovations.effect import Effect
from schwung.innovations.likelihood import Noise


def phased(view: View, noise: Noise) -> View:
    """The session with the phases that make each run likeliest; as it is, where the belief has no such disturbance."""
    effects = view.known.effects
    if effects.periodic_amplitude_nm == 0:
        return view
    without = replace(view.known, effects=effects._replace(periodic_amplitude_nm=0.0))
    about = at_rest(replace(view, known=without), (), noise)
    both = Candidate(
        "phase", lambda along, _: Effect(waves(along, effects.periodic_frequency_hz)), (1.0, 1.0), named=False
    )
    phases = []
    for run in range(len(view.runs)):
        rows = about.whitened([(both, ())], [run])
        sine, cosine = np.linalg.lstsq(rows.T, about.innovations([run]), rcond=None)[0]
        phases.append(float(np.arctan2(cosine, sine)))
    return replace(view, known=replace(view.known, phases_rad=tuple(phases)))
