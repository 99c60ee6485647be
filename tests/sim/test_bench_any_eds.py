"""Whatever an EDS declares, the bench is a drive with it or says why not; it never falls over."""

from __future__ import annotations

import contextlib
import functools
import re
import tempfile
from pathlib import Path

import pytest
from canopen_rig import NODE, Rig
from hypothesis import given, settings
from hypothesis import strategies as st

from schwung_sim.bench import default_eds
from schwung_sim.drives.roles import find_profile, read_profile, read_roles
from schwung_sim.drives.setup import open_dictionary
from schwung_sim.errors import BenchError

INDISPENSABLE = {"6040", "6041"}


@functools.cache
def sections() -> dict[str, str]:
    """Every object of the bench's own EDS with its sub-indices, by its index."""
    found: dict[str, str] = {}
    for match in re.finditer(r"(?ms)^\[([0-9A-F]{4})(?:sub[0-9A-F]+)?\]\n.*?(?=^\[|\Z)", _text()):
        found[match[1]] = found.get(match[1], "") + match[0]
    return found


@functools.cache
def _text() -> str:
    return default_eds().read_text()


@settings(max_examples=40, deadline=None)
@given(st.sets(st.sampled_from(sorted(sections())), max_size=80), st.sampled_from([1, 8]))
def test_any_part_of_a_dictionary_is_a_drive(chosen: set[str], mode: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        text = "".join(body for index, body in sections().items() if index in chosen | INDISPENSABLE)
        (Path(folder) / "drive.eds").write_text(text)
        profile = find_profile("generic-cia402").read_text().replace("generic-cia402.eds", "drive.eds")
        (Path(folder) / "profile.toml").write_text(profile)
        rig = Rig(profile=Path(folder))
    rig.nmt(1)
    if "6060" in chosen:
        rig.write(0x6060, 0, mode, 1)
    for word in (0x06, 0x07, 0x0F, 0x1F):
        rig.control(word)
    assert rig.status & 0x6F == 0x27
    for name, value, size in (("607A", 1000, 4), ("60B2", 10, 2), ("1017", 5, 2)):
        if name in chosen:
            rig.write(int(name, 16), 0, value, size)
    rig.sync(30)
    for entry in rig.servo.dictionary.entries.values():
        if entry.index != 0x1003:
            rig.servo.dictionary.upload(entry.index, entry.subindex)
    rig.servo.fault(0x4310)
    rig.sync(50)
    rig.nmt(0x81)
    assert rig.state == 0x40


_LINE = st.sampled_from(
    [
        "",
        "=",
        "[",
        "]",
        "[6041",
        "DefaultValue=",
        "DataType=0xFF",
        "DataType=0x000F",
        "DataType=0x0008",
        "AccessType=wo",
        "PDOMapping=yes",
        "x",
        "[1018sub]",
    ]
)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 1), st.sampled_from("dixu"), _LINE), max_size=8), st.binary(max_size=3)
)
def test_a_damaged_file_is_a_drive_or_is_refused(damage: list[tuple[float, str, str]], noise: bytes) -> None:
    lines = _text().splitlines()
    for where, kind, text in damage:
        at = min(int(where * len(lines)), len(lines) - 1)
        if kind == "d":
            del lines[at]
        elif kind == "i":
            lines.insert(at, text)
        elif kind == "x":
            lines[at] = lines[at][::-1]
        else:
            lines[at] = lines[at].upper()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "schwung-bench.eds").write_bytes("\n".join(lines).encode() + noise)
        (Path(folder) / "profile.toml").write_text(find_profile("schwung-bench").read_text())
        with contextlib.suppress(BenchError):
            _is_a_drive(Rig(profile=Path(folder)))


def _is_a_drive(rig: Rig) -> None:
    for entry in rig.servo.dictionary.entries.values():
        if entry.readable and entry.index != 0x1003:
            assert isinstance(rig.servo.dictionary.upload(entry.index, entry.subindex), bytes)
    rig.nmt(1)
    for word in (0x06, 0x07, 0x0F):
        rig.give(0x600 + NODE, b"\x2b\x40\x60\x00" + bytes((word, 0, 0, 0)))
    rig.sync(20)
    rig.servo.fault(0x4310)
    rig.sync(20)
    rig.nmt(0x81)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "noise.eds"
    file.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(BenchError, match="no EDS that can be read"):
        open_dictionary(file, 5, read_roles(read_profile(find_profile("schwung-bench"))[0]))


@pytest.mark.parametrize("kind", ["0x000F", "0x0008", "0x0005", "0x0010", "0x001B"])
@pytest.mark.parametrize(
    "title",
    ["1016sub1", "1400sub1", "1600sub1", "6041", "6060", "6064", "6065", "607A", "60AA", "60B2", "60C2sub2"],
)
def test_an_object_of_another_type_makes_another_drive_or_none(title: str, kind: str, tmp_path: Path) -> None:
    pattern = rf"(?ms)(^\[{title}\]\n.*?DataType=)0x[0-9A-F]+"
    (tmp_path / "schwung-bench.eds").write_text(re.sub(pattern, lambda m: m[1] + kind, _text(), count=1))
    (tmp_path / "profile.toml").write_text(find_profile("schwung-bench").read_text())
    if title == "6041":
        with pytest.raises(BenchError, match="16 bits"):
            Rig(profile=tmp_path)
    else:
        _is_a_drive(Rig(profile=tmp_path))
