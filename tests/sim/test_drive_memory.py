"""A supply that fails while the drive stores its parameters (CiA 301 7.5.2.13)."""

import struct
from pathlib import Path

import pytest
from canopen_rig import NODE, Rig

SAVE = 0x65766173
OLD, NEW = 1111, 2222  # values of 6065 and 6067 that are no defaults


def store(rig: Rig) -> list[bytes]:
    """1010:01 as a download, and what is answered."""
    return rig.ask(struct.pack("<BHBI", 0x23, 0x1010, 1, SAVE))


def change(rig: Rig, value: int) -> None:
    for index in (0x6065, 0x6067):
        rig.write(index, 0, value, 4)


def held(rig: Rig) -> tuple[int, int]:
    return rig.read(0x6065), rig.read(0x6067)


@pytest.mark.parametrize("left", [0, 1, 2])
@pytest.mark.parametrize("in_a_file", [False, True])
def test_power_cut_while_storing_leaves_a_whole_memory(left: int, in_a_file: bool, tmp_path: Path) -> None:
    """What was confirmed before, or the defaults, or all that is new; never some of each, and nothing is confirmed."""
    memory = tmp_path / "memory.json" if in_a_file else None
    rig = Rig(memory=memory, faults=f"store-power-cut={left}@0.01")
    expected = {0: (OLD, OLD), 1: held(rig), 2: (NEW, NEW)}[left]
    change(rig, OLD)
    assert len(store(rig)) == 1
    rig.sync(10)
    change(rig, NEW)
    rig.take(0x700 + NODE)
    assert store(rig) == []
    assert rig.take(0x700 + NODE) == [b"\0"]  # boot-up: it was away
    assert held(rig) == expected
    if memory is not None:
        assert held(Rig(memory=memory)) == expected  # the next power-on
        assert [file.name for file in tmp_path.iterdir()] == ["memory.json"]


def test_only_the_next_store_fails() -> None:
    rig = Rig(faults="store-power-cut")
    rig.write(0x6065, 0, NEW, 4)
    assert store(rig) == []
    rig.write(0x6065, 0, NEW, 4)
    assert len(store(rig)) == 1
    rig.nmt(0x81)
    assert rig.read(0x6065) == NEW


def test_other_accesses_do_not_cut_the_power() -> None:
    rig = Rig(faults="store-power-cut")
    rig.write(0x6065, 0, NEW, 4)
    (refused,) = rig.ask(struct.pack("<BHBI", 0x23, 0x1010, 1, 0x12345678))
    assert refused[0] == 0x80  # a wrong signature stores nothing
    assert rig.read(0x6065) == NEW
    assert rig.read(0x1010, 1) == 1
