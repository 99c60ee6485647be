"""What is injected and where the axis goes, before anything moves."""

from types import SimpleNamespace

import numpy as np
import pytest
from commissioning_drive import DeskDrive, Silence, believed_machine

from schwung.commissioning import LimitWishes
from schwung.commissioning.bode import measure_bode, prepare_bode
from schwung.commissioning.bode_excitation import MAX_DEVIATION_RAD, MAX_TORQUE_SHARE, BodeWishes
from schwung.drivetrain import simulate
from schwung.errors import InputError, RefusedError
from schwung.fieldbus.profile import load_profile
from schwung.motion import Demand

PROFILE = load_profile("schwung-bench")


def _profile():
    """The bench's, without gains that this drive does not have: the machine file has them."""
    none = dict.fromkeys(type(PROFILE.control).model_fields)
    return PROFILE.model_copy(update={"control": PROFILE.control.model_copy(update=none)})


def _prepared(**wishes):
    machine = believed_machine()
    wanted = BodeWishes(**{"angles_rad": (0.5, 1.0), **wishes})
    return prepare_bode(DeskDrive(machine), _profile(), machine, wanted)


def test_it_goes_to_each_angle_injects_and_comes_back():
    runs = _prepared().runs
    assert [run.role for run in runs] == [
        "reference",
        *["excited"] * 2,
        "reference",
        *["excited"] * 2,
        "reference",
    ]
    here = 0.0
    for run in runs:
        assert run.start_position_rad == pytest.approx(here)
        here += run.motion.distance_rad
    assert here == pytest.approx(0.0)
    assert {run.start_position_rad for run in runs if run.excitation} == {0.5, 1.0}
    assert all(run.motion.distance_rad == 0 for run in runs if run.excitation)


def test_multisines_differ_from_repeat_to_repeat_and_have_a_whole_period():
    first, second = (run.excitation for run in _prepared().runs[1:3])
    assert first.phases_rad != second.phases_rad
    period = 1000.0 / first.frequency_hz
    assert period == pytest.approx(round(period), abs=1e-9)
    assert max(first.lines_hz) <= 0.4 * 1000
    assert first.hold_s == 1e-3
    time = np.arange(0, first.end_s, 1e-3)
    assert np.max(np.abs(first.torque(time))) <= first.amplitude_nm * (1 + 1e-6)


@pytest.mark.parametrize("waveform", ["multisine", "sine"])
def test_the_axis_stays_at_its_angle_and_the_torque_within_its_share(waveform):
    prepared = _prepared(waveform=waveform, amplitude_nm=200.0)
    still = prepared.preflight.excited
    steady = still.time_s > 0.4 * still.time_s[-1]
    deviation = np.max(np.abs(still.position_rad[steady] - 0.5))
    assert 0.2 * MAX_DEVIATION_RAD < deviation < 1.3 * MAX_DEVIATION_RAD
    assert still.peak_torque_nm < 1.3 * MAX_TORQUE_SHARE * 233
    assert not prepared.preflight.stops


def test_a_stepped_sine_is_one_run_per_frequency_weaker_each_time():
    runs = [
        run for run in _prepared(waveform="sine").runs if run.excitation and run.start_position_rad == 0.5
    ]
    by_repeat = len(runs) // 2
    first, second = runs[:by_repeat], runs[by_repeat:]
    assert [r.excitation.frequency_hz for r in first] == [r.excitation.frequency_hz for r in second]
    for one, other in zip(first, second, strict=True):
        assert other.excitation.amplitude_nm < one.excitation.amplitude_nm
        assert one.excitation.waveform == "sine"


def test_a_sine_takes_no_longer_than_it_needs():
    """Whole periods in each block; by when its block is read, what rings is a thousandth of the steady sine."""
    machine = believed_machine()
    sines = [
        run.excitation
        for run in _prepared(waveform="sine", repeats=1, angles_rad=(0.5,)).runs
        if run.excitation
    ]
    lengths = [sine.end_s for sine in sines]
    assert lengths[0] > 1.5 * lengths[-1]
    assert lengths[-1] == pytest.approx(0.05 + 0.05 + 4 * 0.05 + 0.05)
    still = np.zeros(40000)
    time = np.arange(still.size) / 8000
    for sine in (sines[0], sines[5], sines[-1]):
        settled = sine.ramp_s + sine.settle_s
        made = simulate(machine, Demand(still, still, still), time, sine.torque(time))
        block = 0.2 if sine.frequency_hz < 30 else 0.1 if sine.frequency_hz < 60 else 0.05
        periods = block * sine.frequency_hz
        assert periods == pytest.approx(round(periods), abs=1e-6)
        early, late = (
            _phasor(made.position_rad, time, sine.frequency_hz, start, block)
            for start in (settled, sine.end_s - sine.ramp_s - block)
        )
        assert abs(early / late - 1) < 2e-3


def _phasor(values, time, frequency_hz, start_s, length_s):
    part = (time >= start_s) & (time < start_s + length_s - 1e-9)
    at, turning = time[part], 2 * np.pi * frequency_hz * time[part]
    design = np.stack([np.cos(turning), np.sin(turning), np.ones_like(at), at - at.mean()], axis=1)
    cosine, sine = np.linalg.lstsq(design, values[part], rcond=None)[0][:2]
    return complex(cosine, -sine)


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"highest_hz": 450.0}, "--highest"),
        ({"lowest_hz": 300.0, "highest_hz": 200.0}, "cannot be measured"),
        ({"periods": 1}, "--periods"),
        ({"angles_rad": ()}, "--angles"),
    ],
)
def test_what_cannot_be_measured_is_said(wishes, words):
    with pytest.raises(InputError, match=words):
        _prepared(**wishes)


def test_too_small_a_window_or_torque_stops_it():
    assert any(c.name == "room to move" for c in _prepared(angles_rad=(3.999,)).preflight.stops)
    tight = _prepared(limits=LimitWishes(following_error_rad=1e-3)).preflight
    assert any(c.name == "following error" for c in tight.stops)


def test_ctrl_c_in_the_midst_stops_the_drive_and_puts_parameters_back(tmp_path):
    machine = believed_machine()
    drive = DeskDrive(machine)

    def interrupt(number):
        if number == 1:
            raise KeyboardInterrupt

    drive.before_play = interrupt
    wishes = BodeWishes(angles_rad=(0.5,), periods=2, repeats=1)
    prepared = prepare_bode(drive, _profile(), machine, wishes)
    with pytest.raises(Exception, match="1 of 3 motions"):
        measure_bode(drive, prepared, tmp_path, Silence())
    assert "halt" in drive.calls
    assert drive.calls.index("halt") < drive.calls.index("disable")
    assert drive.objects[0x6060, 0] == 1


def test_a_stop_moves_nothing(tmp_path):
    machine = believed_machine()
    drive = DeskDrive(machine)
    prepared = prepare_bode(drive, _profile(), machine, BodeWishes(angles_rad=(9.0,)))
    with pytest.raises(RefusedError):
        measure_bode(drive, prepared, tmp_path, SimpleNamespace(phase=lambda text: None))
    assert drive.calls == []
