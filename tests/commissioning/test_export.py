"""The table as drive parameters: scaled, compared, undone where it fails."""

import signal
from pathlib import Path

import numpy as np
import pytest
from commissioning_drive import DeskDrive, believed_machine

from schwung.commissioning import (
    ExportChoice,
    export_table,
    export_values,
    parse_choice,
    read_backup,
    restore_backup,
)
from schwung.commissioning.export import scalar_of
from schwung.drivetrain import InertiaTable
from schwung.errors import DriveError, InputError, RefusedError, SdoError
from schwung.fieldbus.dcf import dictionary_lookup, write_dcf
from schwung.fieldbus.drive import DriveState, Parameter, ParameterValue
from schwung.fieldbus.eds import load_dictionary
from schwung.fieldbus.profile import DeviceProfile, Export, load_canopen_profile, load_profile

PROFILE = load_profile("schwung-bench")
TABLE = InertiaTable(np.linspace(0.1, 3.1, 31), 0.1 + 0.05 * np.linspace(0, 1, 31) ** 2)


@pytest.fixture
def drive() -> DeskDrive:
    desk = DeskDrive(believed_machine())
    desk.objects |= {(0x2300, sub): 1 for sub in range(1, 65)}
    desk.objects |= {(0x2301, sub): 0 for sub in (1, 2, 3)} | {(0x2302, sub): 0 for sub in (1, 2)}
    return desk


def test_the_table_arrives_in_the_drives_units(drive: DeskDrive, tmp_path: Path) -> None:
    done = export_table(drive, PROFILE, TABLE, ExportChoice(), backup_path=tmp_path / "e.backup.json")
    angles = np.linspace(0.1, 3.1, 64)
    written = np.array([drive.objects[0x2300, sub] for sub in range(1, 65)]) * 1e-7
    assert np.max(np.abs(written - TABLE.at(angles))) <= 0.5e-7
    assert drive.objects[0x2301, 1] == 100_000
    assert drive.objects[0x2301, 2] * 63e-6 == pytest.approx(3.0, abs=63e-6)
    assert drive.objects[0x2302, 1] == 2
    assert drive.calls[-1] == "store"
    assert done.stored


def test_the_feed_forward_is_switched_on_last() -> None:
    values = export_values(dictionary_lookup(PROFILE.eds_path, 1), PROFILE, TABLE, ExportChoice())
    assert values[-1].parameter.index == 0x2302


def test_old_values_stay_in_the_backup(drive: DeskDrive, tmp_path: Path) -> None:
    path = tmp_path / "e.backup.json"
    export_table(drive, PROFILE, TABLE, ExportChoice("max"), backup_path=path, store=False)
    backup = read_backup(path)
    assert backup.restored is None
    assert {(c.parameter.index, c.parameter.subindex): c.old for c in backup.changes} == {
        (0x2302, 1): 0,
        (0x2302, 2): 0,
    }
    assert "store" not in drive.calls


def test_a_value_that_reads_back_differently_is_undone(drive: DeskDrive, tmp_path: Path) -> None:
    before = dict(drive.objects)
    read = drive.read
    drive.read = lambda parameter: (  # type: ignore[method-assign]  # a drive that does not keep its word
        ParameterValue(parameter, 5)
        if (parameter.index, "write 2302=2" in drive.calls) == (0x2300, True)
        else read(parameter)
    )
    with pytest.raises(DriveError, match="reads 5"):
        export_table(drive, PROFILE, TABLE, ExportChoice(), backup_path=tmp_path / "e.backup.json")
    assert drive.objects == before
    assert "store" not in drive.calls


def test_one_number_for_a_table() -> None:
    assert scalar_of(TABLE, ExportChoice("max")) == pytest.approx(0.15)
    assert scalar_of(TABLE, ExportChoice("mean")) == pytest.approx(0.1 + 0.05 / 3, rel=1e-3)
    assert scalar_of(TABLE, parse_choice("at=0.1")) == pytest.approx(0.1)
    with pytest.raises(InputError, match="outside"):
        scalar_of(TABLE, parse_choice("at=9"))


@pytest.mark.parametrize("text", ["", "median", "at", "at=x", "mean=3"])
def test_unknown_forms_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_choice(text)


def test_a_profile_without_targets_says_so(drive: DeskDrive) -> None:
    generic = load_profile("generic-cia402")
    for form in (ExportChoice(), ExportChoice("mean")):
        with pytest.raises(InputError, match="can't do that, because the standard has no feed-forward"):
            export_values(drive.parameter, generic, TABLE, form)


def exporting(**targets: object) -> DeviceProfile:
    """The bench profile with these targets only."""
    return PROFILE.model_copy(update={"export": Export.model_validate(targets)})


CURRENT_PER_ACCELERATION = {
    "object": "2302:02", "scale_kgm2": 1e-12, "per": "2400:05", "of": "total"
}  # fmt: skip


def test_a_drive_that_wants_current_per_acceleration_gets_it(drive: DeskDrive) -> None:
    """EPOS4: µA·s²/rad, with the torque constant in µN·m/A: 0.3 kg·m² over 0.1 N·m/A is 3 A·s²/rad."""
    drive.objects[0x2400, 5] = 100_000
    even = InertiaTable(np.array([0.0, 1.0]), np.full(2, 0.2))
    values = export_values(
        drive.parameter, exporting(scalar=CURRENT_PER_ACCELERATION), even, ExportChoice("mean"),
        read=drive.read, motor_inertia_kgm2=0.1,
    )  # fmt: skip
    assert [value.raw for value in values] == [3_000_000]


def test_an_epos4_gets_the_number_that_its_own_file_holds() -> None:
    """In the DCF, 30A1:05 is 2777 with 107746 µN·m/A: 2.992e-4 kg·m² in all."""
    profile = load_canopen_profile("maxon-epos4")
    load = InertiaTable(np.array([0.0, 1.0]), np.full(2, 1.0e-4))
    values = export_values(
        dictionary_lookup(profile.eds_path, 1), profile, load, ExportChoice("mean"),
        read=lambda parameter: ParameterValue(parameter, 107_746), motor_inertia_kgm2=1.9921e-4,
    )  # fmt: skip
    assert [(value.parameter.label[:9], value.raw) for value in values] == [("0x30A1:05", 2777)]


def test_what_such_a_number_needs_is_asked_for(drive: DeskDrive) -> None:
    profile, mean = exporting(scalar=CURRENT_PER_ACCELERATION), ExportChoice("mean")
    with pytest.raises(InputError, match=r"motor and load together.*--machine"):
        export_values(drive.parameter, profile, TABLE, mean, read=drive.read)
    drive.objects[0x2400, 5] = 0
    with pytest.raises(InputError, match="Connect to the drive"):
        export_values(drive.parameter, profile, TABLE, mean, motor_inertia_kgm2=0.1)
    with pytest.raises(InputError, match="has no unit without it"):
        export_values(drive.parameter, profile, TABLE, mean, read=drive.read, motor_inertia_kgm2=0.1)


HARMONICS = {
    "offset": {"object": "2F00:00", "scale": 1e-6}, "orders": 3,
    "amplitudes": "2F01", "amplitude_scale_kgm2": 1e-6, "phases": "2F02", "phase_scale_rad": 1e-4,
}  # fmt: skip


def test_harmonics_of_a_turn_are_those_of_the_table() -> None:
    """J = 0.2 + 0.05·cos(θ − 0.3) + 0.01·cos(2θ + 1): offset, amplitudes and phases as written."""
    angles = np.linspace(0.0, 2 * np.pi, 721)
    table = InertiaTable(angles, 0.2 + 0.05 * np.cos(angles - 0.3) + 0.01 * np.cos(2 * angles + 1))
    values = export_values(
        lambda i, s: Parameter(i, s, "INTEGER32"),
        exporting(harmonics=HARMONICS),
        table,
        ExportChoice("harmonics"),
    )
    raw = {(v.parameter.index, v.parameter.subindex): int(v.raw) for v in values}  # integers
    assert raw[0x2F00, 0] == pytest.approx(200_000, abs=2)
    assert [raw[0x2F01, order] for order in (1, 2, 3)] == pytest.approx([50_000, 10_000, 0], abs=20)
    assert [raw[0x2F02, order] for order in (1, 2)] == pytest.approx([3000, -10_000], abs=20)


def test_harmonics_of_a_part_of_a_turn_are_refused() -> None:
    with pytest.raises(InputError, match="one turn"):
        export_values(
            lambda i, s: Parameter(i, s, "INTEGER32"),
            exporting(harmonics=HARMONICS),
            TABLE,
            ExportChoice("harmonics"),
        )


def test_an_inertia_that_does_not_fit_its_object_is_refused(drive: DeskDrive) -> None:
    huge = InertiaTable(np.array([0.0, 1.0]), np.array([1.0, 1e4]))
    with pytest.raises(InputError, match="counts"):
        export_values(drive.parameter, PROFILE, huge, ExportChoice())


def test_a_dcf_carries_the_values(tmp_path: Path) -> None:
    lookup = dictionary_lookup(PROFILE.eds_path, 5)
    values = export_values(lookup, PROFILE, TABLE, ExportChoice())
    write_dcf(PROFILE.eds_path, 5, values, tmp_path / "drive.dcf")
    read = load_dictionary(tmp_path / "drive.dcf", 5)
    for value in values:
        entry = read.indices[value.parameter.index]
        assert entry[value.parameter.subindex].value == value.raw
    assert "NodeID=5" in (tmp_path / "drive.dcf").read_text()


def test_a_drive_whose_power_stage_is_on_gets_no_table(drive: DeskDrive, tmp_path: Path) -> None:
    drive.state = lambda: DriveState("OPERATIONAL", "Operation enabled", 0.0)  # type: ignore[method-assign]
    with pytest.raises(RefusedError, match="Operation enabled"):
        export_table(drive, PROFILE, TABLE, ExportChoice(), backup_path=tmp_path / "e.backup.json")
    assert drive.calls == []


@pytest.mark.parametrize("first", [0, 30, 66, 67])
def test_an_export_that_is_interrupted_again_and_again_leaves_the_old_values(
    drive: DeskDrive, tmp_path: Path, first: int
) -> None:
    before = dict(drive.objects)
    drive.on_call = lambda call: signal.raise_signal(signal.SIGINT) if call >= first else None
    with pytest.raises(KeyboardInterrupt):
        export_table(drive, PROFILE, TABLE, ExportChoice(), backup_path=tmp_path / "e.backup.json")
    assert drive.objects == before
    assert "store" not in drive.calls


def test_an_export_that_cannot_be_undone_says_what_does(drive: DeskDrive, tmp_path: Path) -> None:
    def lost(call: int) -> None:
        if call == 20:
            drive.unwritable |= set(drive.objects)

    drive.on_call = lost
    path = tmp_path / "e.backup.json"
    with pytest.raises(DriveError) as caught:
        export_table(drive, PROFILE, TABLE, ExportChoice(), backup_path=path)
    assert any(f"schwung restore {path}" in note for note in caught.value.__notes__)
    drive.unwritable.clear()
    restore_backup(drive, path)
    held = {key: raw for key, raw in drive.objects.items() if key != (0x6041, 0)}  # which nobody writes
    assert set(held.values()) <= {0, 1, 0x7F012C}


@pytest.mark.parametrize("store", [True, False])
def test_what_was_stored_is_stored_again_when_it_is_put_back(
    drive: DeskDrive, tmp_path: Path, store: bool
) -> None:
    """Otherwise the export would come back at the next power-on."""
    path = tmp_path / "e.backup.json"
    export_table(drive, PROFILE, TABLE, ExportChoice("max"), backup_path=path, store=store)
    drive.calls.clear()
    restore_backup(drive, path)
    assert ("store" in drive.calls) == store


def test_a_drive_that_cannot_store_says_how_long_the_values_last(drive: DeskDrive, tmp_path: Path) -> None:
    def refuse() -> None:
        raise SdoError("0x1010:01", "refused")

    drive.store = refuse  # type: ignore[method-assign]  # a drive without memory
    with pytest.raises(SdoError) as caught:
        export_table(drive, PROFILE, TABLE, ExportChoice("max"), backup_path=tmp_path / "e.backup.json")
    assert any("until power-off" in note for note in caught.value.__notes__)
