"""EDS files as the bench reads them: what a vendor's tool gets wrong does no harm, and a drive has what it needs."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest

from schwung_sim.drives.eds import DOMAIN, Entry, key, read_entries
from schwung_sim.drives.roles import Quantity, Roles
from schwung_sim.drives.setup import open_dictionary
from schwung_sim.errors import BenchError

DRIVE = """
[6040]
ParameterName=Controlword
ObjectType=0x7
DataType=0x0006
AccessType=rww
PDOMapping=1
[6041]
ParameterName=Statusword
ObjectType=0x7
DataType=0x0006
AccessType=ro
PDOMapping=1
"""


def entries_of(tmp_path: Path, text: str | bytes, node_id: int = 5) -> dict[int, Entry]:
    file = tmp_path / "drive.eds"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return {entry.key: entry for entry in read_entries(file, node_id)}


@pytest.mark.parametrize(
    ("data_type", "text", "value"),
    [
        ("0x0007", "$NODEID+0x180", 0x185),
        ("0x0007", "$NodeID + 0x40000180", 0x40000185),
        ("0x0007", "0x180+$NODEID", 0x185),
        ("7", "0X1F", 31),
        ("0x0005", "012", 12),
        ("0x0002", "0xFD", -3),
        ("0x0004", "0x80000000", -(2**31)),
        ("0x0003", "-7", -7),
        ("0x0006", "16 ; a comment", 16),
        ("0x0008", "2.5", 2.5),
        ("0x0009", "EPOS4", b"EPOS4"),
        ("0x000B", "µ", "µ".encode("utf-16-le")),
        ("0x0016", "0x010203", 0x010203),
        ("0x0001", "1", 1),
        ("0x0007", "NULL", None),
        ("0x000F", "NULL", None),
        ("0x0007", "", None),
        ("0x0007", "many", None),
    ],
)
def test_values_are_read_as_their_type_holds_them(
    data_type: str, text: str, value: object, tmp_path: Path
) -> None:
    entry = entries_of(tmp_path, f"[2000]\nDataType={data_type}\nAccessType=rw\nDefaultValue={text}\n")[
        key(0x2000)
    ]
    assert entry.default == value


def test_what_vendors_tools_get_wrong_does_no_harm(tmp_path: Path) -> None:
    text = (
        b"\xef\xbb\xbf; a BOM, and bytes of Windows\r\n[DeviceInfo]\r\nVendorName=M\xfcller \x94GmbH\x94\r\n"
        b"vendornumber=0xAB\r\n[1018sub1]\r\nDataType=7\r\nAccessType=RO\r\n[1018]\r\nobjecttype=9\r\nSubNumber=2\r\n"
        b"[1018SUB0]\r\nDataType=0x05\r\nAccessType=const\r\n[2000]\r\n[2000]\r\nDataType=0x4\r\nDataType=0x3\r\n"
        b"a line that says nothing\r\n[2001]\r\nObjectType=2\r\n[0005]\r\nObjectType=5\r\n"
    ).replace(b"\xef\xbb\xbf", b"")
    found = entries_of(tmp_path, text)
    assert found[key(0x1018, 1)].default == 0xAB
    assert found[key(0x1018, 0)].default == 1
    assert not found[key(0x1018, 1)].writable
    assert found[key(0x2000)].data_type == 3
    assert found[key(0x2000)].writable
    assert found[key(0x2001)].data_type == DOMAIN
    assert len(found) == 4


def test_an_array_in_short_form_has_its_elements(tmp_path: Path) -> None:
    text = (
        "[2100]\nObjectType=0x8\nDataType=0x0003\nAccessType=rw\nCompactSubObj=3\nDefaultValue=7\nParameterName=Gain\n"
        "[2100Value]\nNrOfEntries=1\n2=9\n[2100Name]\nNrOfEntries=1\n3=Last\n"
    )
    found = entries_of(tmp_path, text)
    assert [found[key(0x2100, n)].default for n in range(4)] == [3, 7, 9, 7]
    assert found[key(0x2100, 3)].name == "Last"


def test_of_a_dcf_the_devices_own_values_are_taken_and_no_settings(tmp_path: Path) -> None:
    both = "DefaultValue=1\nParameterValue=2\n"
    text = "".join(
        f"[{index}]\nDataType=7\nAccessType={access}\n{values}"
        for index, access, values in (
            ("2000", "rw", both), ("2001", "rw", "ParameterValue=2\n"), ("6502", "ro", "ParameterValue=0x3A5\n"),
        )
    )  # fmt: skip
    found = entries_of(tmp_path, text)
    assert [found[key(i)].default for i in (0x2000, 0x2001, 0x6502)] == [1, None, 0x3A5]


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ("LowLimit=0x8000\nHighLimit=0x7FFF", (-32768, 32767)),
        ("LowLimit=10\nHighLimit=5", (None, None)),
        ("LowLimit=\nHighLimit=100", (None, 100)),
    ],
)
def test_limits_are_taken_where_they_make_sense(
    limits: str, expected: tuple[int | None, int | None], tmp_path: Path
) -> None:
    entry = entries_of(tmp_path, f"[2000]\nDataType=3\n{limits}\n")[key(0x2000)]
    assert (entry.low, entry.high) == expected


def test_access_says_which_pdo_may_carry_an_object(tmp_path: Path) -> None:
    """CiA 306-1 table 7: rwr is for what the drive sends, rww for what it receives."""
    ways = {"ro": "s", "const": "s", "wo": "r", "rw": "sr", "rwr": "s", "rww": "r"}
    for access, expected in ways.items():
        entry = entries_of(tmp_path, f"[2000]\nDataType=6\nAccessType={access}\nPDOMapping=1\n")[key(0x2000)]
        assert ("s" if entry.sendable else "") + ("r" if entry.receivable else "") == expected
    hidden = entries_of(tmp_path, "[2000]\nDataType=6\nAccessType=rw\nPDOMapping=0\n")[key(0x2000)]
    assert not hidden.sendable
    assert not hidden.receivable


def test_files_that_declare_nothing_or_no_drive_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="declares no object"):
        entries_of(tmp_path, "[FileInfo]\nFileName=x\n")
    with pytest.raises(BenchError, match="no such EDS"):
        read_entries(tmp_path / "absent.eds", 1)
    file = tmp_path / "half.eds"
    file.write_text("[6041]\nDataType=6\n")
    with pytest.raises(BenchError, match="0x6040"):
        open_dictionary(file, 1, Roles())


def drive(tmp_path: Path, more: str, roles: Roles | None = None) -> dict[int, object]:
    file = tmp_path / "drive.eds"
    file.write_text(DRIVE + more)
    dictionary = open_dictionary(file, 5, roles or Roles())
    assert all(dictionary.values[k] == e.default for k, e in dictionary.entries.items())
    return dict(dictionary.values)


def test_what_is_missing_is_held_but_not_shown(tmp_path: Path) -> None:
    file = tmp_path / "drive.eds"
    file.write_text(DRIVE)
    dictionary = open_dictionary(file, 5, Roles())
    assert set(dictionary.entries) == {key(0x6040), key(0x6041)}
    number = dictionary.number
    assert (number(0x1014), number(0x6007), number(0x605A), number(0x60C2, 1), number(0x60C2, 2)) == (
        0x85,
        1,
        2,
        1,
        -3,
    )
    assert number(0x6502) == 1 << 0 | 1 << 7
    assert number(0x6076) == 70_000


def test_zeros_that_would_hold_the_axis_are_replaced_and_nothing_else_is(tmp_path: Path) -> None:
    more = "".join(
        f"[{index}]\nDataType=7\nAccessType=rw\nDefaultValue={value}\n"
        for index, value in {
            "6065": 0,
            "6067": 7,
            "607F": 0,
            "6081": 500,
            "6085": 0,
            "6076": 0,
            "6007": 0,
        }.items()
    )
    held = drive(tmp_path, more)
    turn = 2**20 / (2 * math.pi)
    assert held[key(0x6065)] == round(0.6 * turn)
    assert held[key(0x6067)] == 7
    assert held[key(0x607F)] == 6_000_000  # 10^-3 rpm
    assert held[key(0x6081)] == 500
    assert held[key(0x6085)] == 10_000_000
    assert held[key(0x6076)] == 70_000
    assert held[key(0x6007)] == 0


def test_what_is_filled_in_keeps_to_type_and_limits(tmp_path: Path) -> None:
    more = "[6065]\nDataType=4\nAccessType=rw\nHighLimit=5000\n[6072]\nDataType=6\nAccessType=rw\n"
    held = drive(tmp_path, more)
    assert held[key(0x6065)] == 5000
    assert held[key(0x6072)] == round(233 / 70 * 1000)


def test_a_profile_says_in_what_the_motor_is_told(tmp_path: Path) -> None:
    torque = Quantity(key(0x6077), "rated_torque", rated_torque_scale=1e-6)
    roles = Roles(
        modes={"pp": 1},
        position=Quantity(key(0x6064), "increments", resolution=key(0x2210, 1), resolution_factor=4.0),
        torque=torque,
        torque_added=None,
    )
    held = drive(
        tmp_path, "[2210sub1]\nDataType=6\nAccessType=rw\n[6076]\nDataType=7\nAccessType=rw\n", roles
    )
    assert held[key(0x6076)] == 70_000_000
    assert held[key(0x2210, 1)] == 65535  # 2^18 pulses of four do not fit: as many as its type holds
    assert held[key(0x6502)] == 1


def test_numbers_go_over_the_bus_in_as_many_bytes_as_their_type_has() -> None:
    def entry(data_type: int) -> Entry:
        return Entry(0x2000, 0, "", data_type, "rw", None, None, None, False)

    assert entry(0x10).encode(-2) == b"\xfe\xff\xff"
    assert entry(0x10).decode(b"\xfe\xff\xff") == -2
    assert entry(0x16).decode(b"\x01\x02\x03") == 0x030201
    assert entry(0x08).encode(1.5) == struct.pack("<f", 1.5)
    assert entry(0x16).size == 3
    assert entry(0x09).size is None
