"""The journal: on disk before the drive is touched, and back afterwards."""

import json
from pathlib import Path

import pytest
from commissioning_drive import DeskDrive, believed_machine

from schwung.commissioning import ParameterJournal, read_backup, restore_backup
from schwung.errors import DriveError, InputError, RefusedError, SdoError
from schwung.fieldbus.drive import Parameter, ParameterValue


@pytest.fixture
def drive() -> DeskDrive:
    return DeskDrive(believed_machine())


def _journal(drive: DeskDrive, folder: Path) -> ParameterJournal:
    return ParameterJournal(drive, folder / "a.backup.json", drive.describe())


def test_the_old_value_is_on_disk_before_the_drive_is_written(drive: DeskDrive, tmp_path: Path) -> None:
    seen: list[dict[str, object]] = []
    write = drive.write

    def spying_write(values: list[ParameterValue]) -> None:
        seen.extend(json.loads((tmp_path / "a.backup.json").read_text())["changes"])
        write(values)

    drive.write = spying_write  # type: ignore[method-assign, assignment]  # a spy
    _journal(drive, tmp_path).change([ParameterValue(drive.parameter(0x6060), 8)])
    assert [(entry["index"], entry["old"], entry["new"]) for entry in seen] == [("0x6060", 1, 8)]


def test_restore_puts_back_what_was_there_before_the_first_of_several_changes(
    drive: DeskDrive, tmp_path: Path
) -> None:
    before = dict(drive.objects)
    journal = _journal(drive, tmp_path)
    journal.change([ParameterValue(drive.parameter(0x6060), 8), ParameterValue(drive.parameter(0x1017), 100)])
    journal.change([ParameterValue(drive.parameter(0x6060), 9)])
    assert drive.objects != before
    journal.restore()
    assert drive.objects == before
    assert read_backup(tmp_path / "a.backup.json").restored is not None


def test_equal_values_are_neither_written_nor_journalled(drive: DeskDrive, tmp_path: Path) -> None:
    journal = _journal(drive, tmp_path)
    journal.change([ParameterValue(drive.parameter(0x6060), 1)])
    assert journal.changes == ()
    assert drive.calls == []


def test_a_backup_that_was_not_put_back_is_never_overwritten(drive: DeskDrive, tmp_path: Path) -> None:
    _journal(drive, tmp_path).change([ParameterValue(drive.parameter(0x6060), 8)])
    with pytest.raises(RefusedError, match="schwung restore"):
        _journal(drive, tmp_path)


def test_a_crashed_run_is_restored_from_the_file(drive: DeskDrive, tmp_path: Path) -> None:
    before = dict(drive.objects)
    _journal(drive, tmp_path).change(
        [ParameterValue(drive.parameter(0x6060), 8), ParameterValue(drive.parameter(0x1016, 1), 5)]
    )
    restore_backup(drive, tmp_path / "a.backup.json")
    assert drive.objects == before


def test_a_write_that_fails_half_way_can_still_be_restored(drive: DeskDrive, tmp_path: Path) -> None:
    before = dict(drive.objects)
    drive.unwritable.add((0x1017, 0))
    journal = _journal(drive, tmp_path)
    with pytest.raises(SdoError):
        journal.change(drive.setup(None))  # type: ignore[arg-type]  # not looked at
    drive.unwritable.clear()
    journal.restore()
    assert drive.objects == before


def test_what_a_write_passes_through_is_in_the_backup_too(drive: DeskDrive, tmp_path: Path) -> None:
    """A PDO is switched off while its mapping is written: who is killed meanwhile leaves it so."""
    drive.on_the_way = [(0x1017, 0)]
    before = dict(drive.objects)

    def killed(values: list[ParameterValue]) -> None:
        drive.objects[0x1017, 0] = 77  # off for now
        raise KeyboardInterrupt

    write, drive.write = drive.write, killed  # type: ignore[method-assign, assignment]  # a kill
    with pytest.raises(KeyboardInterrupt):
        _journal(drive, tmp_path).change([ParameterValue(drive.parameter(0x6060), 8)])
    drive.write = write  # type: ignore[method-assign]  # as before
    restore_backup(drive, tmp_path / "a.backup.json")
    assert drive.objects == before


@pytest.mark.parametrize("by", ["journal", "file"])
def test_a_value_that_is_taken_after_the_others_is_put_back(
    by: str, drive: DeskDrive, tmp_path: Path
) -> None:
    """A target lies outside the window of a plan, and inside the one that is put back after it."""
    before = dict(drive.objects)
    journal = _journal(drive, tmp_path)
    journal.change([ParameterValue(drive.parameter(0x6060), 8), ParameterValue(drive.parameter(0x1017), 77)])
    write = drive.write

    def picky(values: list[ParameterValue]) -> None:
        if values[0].parameter.index == 0x1017 and drive.objects[0x6060, 0] == 8:
            raise SdoError(f"node 3, {values[0].parameter.label}", "the drive refused to write it")
        write(values)

    drive.write = picky  # type: ignore[method-assign, assignment]  # a drive with rules
    if by == "journal":
        journal.restore()
    else:
        restore_backup(drive, tmp_path / "a.backup.json")
    assert drive.objects == before
    assert read_backup(tmp_path / "a.backup.json").restored is not None


def test_another_drive_is_refused(drive: DeskDrive, tmp_path: Path) -> None:
    _journal(drive, tmp_path).change([ParameterValue(drive.parameter(0x6060), 8)])
    other = DeskDrive(believed_machine())
    other.identity = type(other.identity)(3, 0x53574E47, 0x402, 0x10000, 8, "another")
    with pytest.raises(RefusedError, match="serial"):
        restore_backup(other, tmp_path / "a.backup.json")
    restore_backup(other, tmp_path / "a.backup.json", force=True)
    assert other.objects[0x6060, 0] == 1


def test_a_value_that_is_refused_does_not_keep_the_others_from_being_put_back(
    drive: DeskDrive, tmp_path: Path
) -> None:
    before = dict(drive.objects)
    path = tmp_path / "a.backup.json"
    _journal(drive, tmp_path).change(drive.setup(None))  # type: ignore[arg-type]  # not looked at
    drive.unwritable.add((0x1016, 1))
    with pytest.raises(DriveError, match=r"2 of 3 parameters are put back, but not 0x1016"):
        restore_backup(drive, path)
    assert {key for key in before if drive.objects[key] != before[key]} == {(0x1016, 1)}
    assert read_backup(path).restored is None
    drive.unwritable.clear()
    restore_backup(drive, path)
    assert drive.objects == before
    assert read_backup(path).restored is not None


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("", "JSON"),
        ("[]", "format"),
        ('{"format": "schwung-backup", "version": 9}', "version"),
        ('{"format": "schwung-backup", "version": 1, "changes": [{"index": "zz"}]}', r"changes\[0\]"),
    ],
)
def test_damaged_files_are_refused_with_their_place(tmp_path: Path, text: str, place: str) -> None:
    path = tmp_path / "b.backup.json"
    path.write_text(text)
    with pytest.raises(InputError, match=place):
        read_backup(path)


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_backup(tmp_path / "none.json")


def test_bytes_survive_the_file(drive: DeskDrive, tmp_path: Path) -> None:
    parameter = drive.parameter(0x6060)
    journal = _journal(drive, tmp_path)
    drive.objects[0x6060, 0] = b"\x01\xff"  # type: ignore[assignment]  # a DOMAIN
    drive.write = lambda values: None  # raw bytes are not its business  # type: ignore[method-assign]
    journal.change([ParameterValue(parameter, b"\x02\x00")])
    change = read_backup(tmp_path / "a.backup.json").changes[0]
    assert (change.old, change.new) == (b"\x01\xff", b"\x02\x00")


def test_a_register_is_not_taken_for_the_object_of_the_same_number(drive: DeskDrive, tmp_path: Path) -> None:
    register = Parameter(0x6060, 0, "INTEGER32", "Position window", space="register")
    answers = {"register": 7, "object": 1}
    drive.read = lambda p: ParameterValue(p, answers[p.space])  # type: ignore[method-assign]  # two spaces
    _journal(drive, tmp_path).change(
        [ParameterValue(register, 9), ParameterValue(drive.parameter(0x6060), 8)]
    )
    written = json.loads((tmp_path / "a.backup.json").read_text())["changes"]
    assert written[0]["register"] == 24672
    assert "index" not in written[0]
    put_back = restore_backup(drive, tmp_path / "a.backup.json")
    assert [(v.parameter.space, v.raw) for v in put_back] == [("object", 1), ("register", 7)]
    assert put_back[1].parameter.label == "register 24672 Position window"
