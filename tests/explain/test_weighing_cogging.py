"""Cogging that is no sine: teeth and magnets have edges."""

import numpy as np
import pytest
from strangers import Stranger, belief_of, session_of

from schwung.drivetrain.effects import effects_of
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.weigh import weigh

AMPLITUDE, ORDER = 0.5, 11.0


@pytest.mark.long
def test_its_second_wave_is_no_error_of_an_encoder() -> None:
    """Alone, a sine was laid between the two waves, at an order that is not the motor's; what it left had the names of
    an encoder and of a transmission."""
    stranger = Stranger("slots", ("cogging",), slots=(AMPLITUDE, ORDER))
    found = publish(session_of(stranger, 5, every=8, times=(0.25, 0.4)), belief_of(stranger))
    assert [one.physics for one in found.names if one.probability > 0.05] == ["cogging"]
    told = found.names[0].parameters
    angle = np.linspace(0, 2 * np.pi, 4097)[:-1]
    wave = AMPLITUDE * np.sin(angle) / (1 + 0.3 * np.cos(angle))
    first, second = (2 * np.mean(wave * np.sin(n * angle)) for n in (1, 2))
    assert told["order"].value == pytest.approx(ORDER, rel=1e-3)
    assert told["amplitude_nm"].value == pytest.approx(first, rel=0.02)
    assert told["second_amplitude_nm"].value == pytest.approx(abs(second), rel=0.05)
    effects = effects_of(found.machine.physics)
    assert [order for _, order, _ in effects.cogging_waves] == pytest.approx([ORDER, 2 * ORDER], rel=1e-3)
    assert found.proof.after < 1.1


@pytest.mark.long
def test_a_sine_has_one_wave() -> None:
    stranger = Stranger("teeth", ("cogging",), teeth=(AMPLITUDE, ORDER, 0.0))
    found = weigh(session_of(stranger, 5, every=8, times=(0.25, 0.4)), belief_of(stranger))
    assert [one.name for one in found.names if one.probability > 0.05] == ["cogging"]
    assert "second_amplitude_nm" not in found.names[0].parameters
