"""The creep through the whole bus chain: a wrong unit or sign is found while the axis has hardly moved, in the drive's
own units; a right one passes, whatever the machine has of friction, play and weight."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from bench_machine import Desk, desk

from schwung.commissioning import LimitWishes, read_backup
from schwung.errors import DriveError, RefusedError
from schwung.fieldbus.drive import ParameterValue, Recording
from schwung.fieldbus.profile import CanopenProfile, load_canopen_profile
from schwung.session import read_session

COUNT_RAD = 2 * math.pi / 2**20  # of the bench's encoder
RPM = 2 * math.pi / 60
PER_MILLE_NM = 0.07
#: What the axis may do before a wrong unit is found, by its own encoder: the creep as it would be with right units.
FAR_RAD, FAST_RAD_S = math.radians(12.5), 1.5
LIMITS = LimitWishes(-2.0, 5.0, 80.0, 230.0, 0.6)


@pytest.fixture(autouse=True)
def unpredicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What preflight foretells of the estimate takes seconds; it is tested in tests/commissioning/test_preflight.py."""
    monkeypatch.setattr("schwung.commissioning.preflight._predicted", lambda *_: None)


def mistaken(**quantities: dict[str, Any] | None) -> CanopenProfile:
    """The tool's profile where it differs from the drive: what is updated in each quantity, None where it has none."""
    own = load_canopen_profile("schwung-bench")
    held = own.quantities
    changed = {
        name: None if update is None else getattr(held, name).model_copy(update=update)
        for name, update in quantities.items()
    }
    pdos = (
        tuple(p for p in own.pdo if p.number == 1)
        if "speed" in quantities and changed["speed"] is None
        else own.pdo
    )
    return own.model_copy(update={"quantities": held.model_copy(update=changed), "pdo": pdos})


def literal(scale: float) -> dict[str, Any]:
    return {"unit": "literal", "scale": scale}


def rated(factor: float) -> dict[str, Any]:
    """A rated torque (6076) that is taken for so many times what it is."""
    scale = {"rated_torque_scale": 1e-3 * factor}
    return {"torque": scale, "torque_added": scale}


class Plant:
    """Watches the machine itself, and has the drive's own window out of the way."""

    def __init__(self, room: Desk) -> None:
        self.far_rad = self.fast_rad_s = self.torque_nm = 0.0
        self._axis = room.bench.axis
        room.bench.servo.on_advance = self._look
        room.drive.write([ParameterValue(room.drive.parameter(0x607D, n), 0) for n in (1, 2)])
        room.drive.write([ParameterValue(room.drive.parameter(0x6065), 0xFFFFFFFF)])

    def _look(self) -> None:
        axis = self._axis
        self.far_rad = max(self.far_rad, abs(axis.plant.motor_rad))
        self.fast_rad_s = max(self.fast_rad_s, abs(axis.speed_rad_s))
        self.torque_nm = max(self.torque_nm, abs(axis.torque_nm))


#: Of each kind the least and the furthest, at least: what lies between them is found by the same comparison.
WRONG = {
    # a gear or an encoder taken for another: the speed, in rpm, is right
    "position a 256th": ({"position": literal(COUNT_RAD / 256)}, "speed"),
    "position a tenth": ({"position": literal(COUNT_RAD / 10)}, "speed"),
    "position half": ({"position": literal(COUNT_RAD / 2)}, "speed"),
    "position twice": ({"position": literal(COUNT_RAD * 2)}, "speed"),
    "position a hundredfold": ({"position": literal(COUNT_RAD * 100)}, "speed"),
    # likewise where there is no other speed: against the torque
    "position a 256th, no speed": ({"position": literal(COUNT_RAD / 256), "speed": None}, "times more"),
    "position half, no speed": ({"position": literal(COUNT_RAD / 2), "speed": None}, "times more"),
    "position twice, no speed": ({"position": literal(COUNT_RAD * 2), "speed": None}, "times less"),
    "position four times, no speed": ({"position": literal(COUNT_RAD * 4), "speed": None}, "times less"),
    # the speed alone
    "speed for rad/s": ({"speed": literal(1e-3)}, "speed"),
    "speed 1000": ({"speed": literal(RPM)}, "speed.*1000 times"),
    "speed per minute": ({"speed": literal(1e-3 * RPM / 60)}, "speed.*1/60 of"),
    # the rated torque
    "rated half": (rated(0.5), "times less"),
    "rated twice": (rated(2), "times more"),
    "rated ten": (rated(10), "times more"),
    "rated 1000": (rated(1000), "times more"),
    "reported torque ten times": ({"torque": literal(10 * PER_MILLE_NM)}, "holds 10"),
    # signs
    "60B2 reversed": ({"torque_added": literal(-PER_MILLE_NM)}, "opposite sign"),
    "6077 reversed": ({"torque": literal(-PER_MILLE_NM)}, "opposite sign"),
    "606C reversed": ({"speed": literal(-1e-3 * RPM)}, "opposite sign"),
    "6064 reversed": ({"position": literal(-COUNT_RAD)}, "opposite sign"),
    "6064 and 606C reversed": (
        {"position": literal(-COUNT_RAD), "speed": literal(-1e-3 * RPM)}, "opposite direction",
    ),
    "60B2 and 6077 reversed": (
        {"torque": literal(-PER_MILLE_NM), "torque_added": literal(-PER_MILLE_NM)}, "opposite direction",
    ),
}  # fmt: skip


#: What may hide in strong friction, of each kind the least and the furthest: the creep grows until they show.
HIDDEN_BY_FRICTION = (
    "position a tenth", "position half", "position twice", "position a hundredfold", "position half, no speed",
    "position twice, no speed", "speed for rad/s", "rated half", "rated twice", "rated 1000", "60B2 reversed",
    "6064 and 606C reversed",
)  # fmt: skip


@pytest.mark.parametrize(
    ("conceal", "case"),
    [*(("", case) for case in WRONG), *(("coulomb_friction=8", case) for case in HIDDEN_BY_FRICTION)],
)
def test_a_wrong_unit_or_sign_is_found_before_the_first_stroke(
    case: str, conceal: str, tmp_path: Path
) -> None:
    quantities, words = WRONG[case]
    with desk(seed=3, profile=mistaken(**quantities), conceal=conceal) as room:
        held = [
            room.drive.read(room.drive.parameter(index)).raw for index in (0x6060, 0x6066, 0x6080, 0x6085)
        ]
        plant = Plant(room)
        with pytest.raises(RefusedError, match=None if conceal else words) as caught:
            room.record(tmp_path / "out", limits=LIMITS)
        assert caught.value.place == "creep"
        assert len(str(caught.value)) < 400
        assert plant.far_rad < FAR_RAD
        assert plant.fast_rad_s < FAST_RAD_S
        assert not room.bench.servo.power.energised
        assert [
            room.drive.read(room.drive.parameter(i)).raw for i in (0x6060, 0x6066, 0x6080, 0x6085)
        ] == held
        assert read_backup(tmp_path / "out" / "setup.backup.json").restored
    assert read_session(tmp_path / "out" / "session.h5").runs == ()


def creep_alone(room: Desk, out: Path, **wishes: Any) -> str:
    """What the creep's last stage showed; no stroke is made, which would not be refused any more."""
    assert room.record(out, runs=(), **wishes).runs == ()
    with h5py.File(out / "session.h5") as file:
        stages = file["creep"]
        return str(stages[max(stages)].attrs["told"])


RIGHT: dict[str, dict[str, Any]] = {
    "as it is": {},
    "crank": {"plant": "slider-crank"},
    "friction": {"conceal": "coulomb_friction=15"},
    "stick": {"conceal": "stribeck_friction:coulomb_torque_nm=5:breakaway_torque_nm=10"},
    "weight": {"conceal": "coulomb_friction=8,load_torque:table=-1/5~5/5"},
    "offset": {"conceal": "coulomb_friction=8,torque_offset=-5"},
    "play": {"conceal": "backlash=0.002"},
    "three times the load": {"conceal": "load_inertia:scale=3"},
    "a third of the load": {"conceal": "load_inertia:scale=0.33"},
    "late speed": {"conceal": "measurement_delay=0.002"},
    "late torque": {"conceal": "torque_lag=0.002"},
    "cogging": {"conceal": "cogging"},
    "soft coupling": {"conceal": "coupling_stiffness"},
    "strong motor": {"conceal": "torque_constant=1.2"},
}


@pytest.mark.parametrize("machine", RIGHT)
def test_right_units_pass_whatever_the_machine_has(machine: str, tmp_path: Path) -> None:
    with desk(seed=4, **RIGHT[machine]) as room:
        assert creep_alone(room, tmp_path / "out", sample_rate_hz=500.0)


@pytest.mark.parametrize(
    "wishes",
    [
        {"mode": "pp"},
        {"mode": "csp", "sampling": "trace", "injecting": "setpoints"},
        {"mode": "pp", "sampling": "trace", "injecting": "generator", "trace_rate_hz": 2000.0},
        {"injecting": "generator"},
        {"sample_rate_hz": 250.0, "duration_s": 0.5},
        {"sample_rate_hz": 2000.0},
        {"distance_rad": -0.5, "returns": False},
        {"distance_rad": 0.05, "duration_s": 0.1},
    ],
    ids=str,
)
def test_right_units_pass_whichever_way_is_taken(wishes: dict[str, Any], tmp_path: Path) -> None:
    with desk(seed=4) as room:
        assert creep_alone(room, tmp_path / "out", **wishes)
        assert room.bench.axis.position_rad == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    "way",
    [{"mode": "pp"}, {"mode": "pp", "sampling": "trace", "injecting": "generator", "trace_rate_hz": 2000.0}],
    ids=["by SYNC", "by itself"],
)
@pytest.mark.parametrize("case", ["position a 256th", "rated ten", "6077 reversed"])
def test_a_drive_that_moves_by_itself_is_found_out_too(
    case: str, way: dict[str, Any], tmp_path: Path
) -> None:
    quantities, _ = WRONG[case]
    with desk(seed=3, profile=mistaken(**quantities)) as room:
        plant = Plant(room)
        with pytest.raises(RefusedError, match="creep"):
            room.record(tmp_path / "out", limits=LIMITS, **way)
        assert plant.far_rad < FAR_RAD
        assert plant.fast_rad_s < FAST_RAD_S
        assert not room.bench.servo.power.energised


def test_what_the_gains_could_not_tell_is_not_told_as_proven_without_a_word(tmp_path: Path) -> None:
    """Twice the torque that is believed: at 500 Hz friction leaves of it only what the file's masses allow."""
    with desk(seed=3, profile=mistaken(**WRONG["rated half"][0]), conceal="coulomb_friction=8") as room:
        told = creep_alone(room, tmp_path / "out", limits=LIMITS, sample_rate_hz=500.0)
    assert re.search(r"no better than that .* kg·m² move.*a faster --rate may", told), told


def test_a_drive_that_ignores_its_setpoints_is_refused(tmp_path: Path) -> None:
    """Bit 12 in cyclic position: the drive follows the command value."""
    with desk(seed=3) as room:
        servo = room.bench.servo
        servo.dictionary.readers[0x6041 << 8] = lambda: servo.operation.status & ~0x1000
        with pytest.raises(RefusedError, match="bit 12"):
            room.record(tmp_path / "out")
        assert not servo.power.energised


def test_units_are_not_accused_where_sync_came_unevenly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is off may be the time: a speed is half of what the position does where SYNC comes half as often."""
    with desk(seed=3, profile=mistaken(speed=literal(2e-3 * RPM))) as room:
        play = room.drive.play

        def uneven(*given: Any) -> Recording:
            recording = play(*given)
            timing = replace(recording.timing, producer="thread", p99_s=5e-4, max_s=2e-3)
            return replace(recording, timing=timing)

        monkeypatch.setattr(room.drive, "play", uneven)
        with pytest.raises(DriveError, match="SYNC: came unevenly"):
            room.record(tmp_path / "out", limits=LIMITS)
        assert not room.bench.servo.power.energised


def test_an_axis_that_is_held_fast_is_no_proof(tmp_path: Path) -> None:
    with desk(seed=3, conceal="coulomb_friction=400") as room:
        with pytest.raises(RefusedError, match="creep") as caught:
            room.record(tmp_path / "out", limits=LIMITS, sample_rate_hz=500.0)
        assert "brake" in str(caught.value)
        assert not room.bench.servo.power.energised


def test_what_the_creep_saw_is_kept_beside_the_runs(tmp_path: Path) -> None:
    with desk(seed=3) as room:
        session = room.record(tmp_path / "out")
    assert [run.role for run in session.runs] == ["reference", "excited"]
    with h5py.File(tmp_path / "out" / "session.h5") as file:
        stages = file["creep"]
        assert len(stages) == 2  # nothing hides the injection: standing still, and one stroke
        assert "proven" in stages["0000"].attrs["told"]
        assert np.ptp(stages["0001"]["position"][:]) < FAR_RAD
