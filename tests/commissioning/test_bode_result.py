"""What bode found, read for commissioning: gaps are filled, wishes and good beliefs stay, reasons are told."""

import json

import pytest
from commissioning_drive import believed_machine

from schwung.commissioning import LimitWishes, Wishes
from schwung.commissioning.bode_result import read_bode
from schwung.errors import InputError

STROKE = {"distance_rad": -3.14, "duration_s": 0.25, "room_rad": None}


def _document(**changes):
    fitted = {
        "motor_inertia_kgm2": {"value": 0.0118, "std": 0.0011, "determined": True},
        "stiffness_nm_rad": {"value": 25100.0, "std": 80.0, "determined": True},
        "damping_nms": {"value": 8.9, "std": 0.2, "determined": True},
    }
    phased = {"frequency_hz": 62.5, "amplitude_nm": 41.0, "expected_error_kgm2": 0.0001}
    proposal = {
        "frequency_hz": 83.3, "amplitude_nm": 40.0, "expected_error_kgm2": 0.0012, "stroke": STROKE,
        "in_phases": phased,
    }  # fmt: skip
    return {"format": "schwung-bode", "version": 1, "parameters": fitted, "proposal": proposal} | changes


def _read(tmp_path, document):
    (tmp_path / "bode.json").write_text(json.dumps(document))
    return read_bode(tmp_path)


def _wishes(**changes):
    return Wishes(**{"distance_rad": 3.14, "duration_s": 0.25, "limits": LimitWishes(), **changes})


def test_the_proposal_fills_the_gaps_and_says_so(tmp_path):
    wishes = _read(tmp_path, _document()).wishes(_wishes())
    assert (wishes.frequency_hz, wishes.amplitude_nm) == (83.3, 40.0)
    first, second = wishes.because
    assert "83.3 Hz with 40 N·m: bode's proposal for 3.14 rad in 250 ms, expected error 0.0012" in first
    assert "stiffness 2.51e+04 N·m/rad, damping 8.9" in second


def test_four_phases_have_a_proposal_of_their_own(tmp_path):
    wishes = _read(tmp_path, _document()).wishes(_wishes(phases=4))
    assert (wishes.frequency_hz, wishes.amplitude_nm) == (62.5, 41.0)
    assert "62.5 Hz with 41 N·m" in wishes.because[0]


def test_what_was_typed_stays(tmp_path):
    wishes = _read(tmp_path, _document()).wishes(_wishes(frequency_hz=50.0))
    assert (wishes.frequency_hz, wishes.amplitude_nm) == (50.0, 40.0)
    assert "Hz" not in wishes.because[0]


def test_only_what_is_known_better_than_by_a_data_sheet_replaces_the_belief(tmp_path):
    machine = _read(tmp_path, _document()).machine(believed_machine())
    assert machine.coupling.stiffness_nm_rad == 25100.0
    assert machine.coupling.damping_nms == 8.9
    assert machine.motor.inertia_kgm2 == believed_machine().motor.inertia_kgm2  # ±9 %
    assert machine.load == believed_machine().load


def test_a_rigid_band_leaves_the_machine_as_it_was(tmp_path):
    found = _read(tmp_path, _document(parameters={}, proposal=None))
    assert found.machine(believed_machine()) == believed_machine()
    assert found.wishes(_wishes()) == _wishes()


@pytest.mark.parametrize("other", [{"duration_s": 0.15}, {"distance_rad": 1.0}])
def test_another_motion_is_pointed_out(tmp_path, other):
    wishes = _read(tmp_path, _document()).wishes(_wishes(**other))
    assert any("another motion" in reason for reason in wishes.because)
    assert not any(
        "another motion" in reason for reason in _read(tmp_path, _document()).wishes(_wishes()).because
    )


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ({"format": "schwung-explanation"}, "is not what `schwung bode` writes"),
        ([], "is not what"),
        (_document(version=2), "has version 2"),
        (_document(proposal={"frequency_hz": "50"}), r"proposal\.frequency_hz: is '50'"),
        (_document(parameters={"damping_nms": {"value": -1.0, "std": 0.1}}), r"damping_nms\.value: is -1\.0"),
        (_document(parameters=[1]), "is not what"),
        (
            _document(proposal={"frequency_hz": 50.0, "stroke": {"distance_rad": "far"}}),
            "distance_rad: is 'far'",
        ),
    ],
)
def test_anything_else_is_refused(tmp_path, document, words):
    with pytest.raises(InputError, match=words):
        _read(tmp_path, document)


def test_a_folder_without_it_is_named(tmp_path):
    with pytest.raises(InputError, match=r"bode\.json: cannot be read"):
        read_bode(tmp_path)
    (tmp_path / "bode.json").write_text("{")
    with pytest.raises(InputError, match="is not what"):
        read_bode(tmp_path / "bode.json")
