"""The injected torque as a sum of sines."""

import numpy as np
import pytest
from pydantic import ValidationError

from schwung.motion import Excitation

LINES, AMPLITUDES, PHASES = (4.0, 10.0, 26.0), (1.0, 2.0, 3.0), (0.3, -1.0, 2.5)


def _multisine(**changes):
    return Excitation(
        **{
            "waveform": "multisine", "frequency_hz": 2.0, "amplitude_nm": 6.0, "frequencies_hz": LINES,
            "amplitudes_nm": AMPLITUDES, "phases_rad": PHASES, **changes,
        }
    )  # fmt: skip


def test_torque_is_the_sum_of_its_lines_and_repeats_with_the_base_frequency():
    time = np.arange(1000) / 1000
    torque = _multisine().torque(time)
    by_hand = sum(
        a * np.sin(2 * np.pi * f * time + p) for f, a, p in zip(LINES, AMPLITUDES, PHASES, strict=True)
    )
    assert torque == pytest.approx(by_hand, abs=1e-12)
    assert torque[:500] == pytest.approx(torque[500:], abs=1e-9)
    assert np.max(np.abs(torque)) <= 6.0


def test_it_fades_like_a_sine():
    time = np.arange(0, 1.2, 1e-3)
    faded = _multisine(ramp_s=0.1, end_s=1.0).torque(time)
    assert faded[0] == 0
    assert np.all(faded[time >= 1.0] == 0)
    steady = (time > 0.1) & (time < 0.9)
    assert faded[steady] == pytest.approx(_multisine().torque(time)[steady], abs=1e-12)


def test_a_sine_has_one_line_and_the_phasor_of_a_sine():
    sine = Excitation(frequency_hz=50.0, amplitude_nm=3.0, phase_rad=0.7)
    assert sine.lines_hz.tolist() == [50.0]
    time = np.linspace(0, 0.1, 200)
    turning = np.real(sine.phasors_nm[0] * np.exp(2j * np.pi * 50 * time))
    assert turning == pytest.approx(sine.torque(time), abs=1e-12)


def test_json_holds_it_whole_and_a_sine_stays_as_the_file_says():
    assert Excitation.model_validate_json(_multisine().model_dump_json(exclude_none=True)) == _multisine()
    plain = Excitation(frequency_hz=50.0, amplitude_nm=3.0).model_dump(exclude_none=True)
    assert plain == {"waveform": "sine", "frequency_hz": 50.0, "amplitude_nm": 3.0, "phase_rad": 0.0}


@pytest.mark.parametrize(
    "wrong",
    [{"frequencies_hz": None}, {"phases_rad": (0.0,)}, {"frequencies_hz": (4.0, 10.0, 27.0)},
     {"frequencies_hz": (-4.0, 10.0, 26.0)}],
)  # fmt: skip
def test_what_is_no_multisine_is_refused(wrong):
    with pytest.raises(ValidationError):
        _multisine(**wrong)
