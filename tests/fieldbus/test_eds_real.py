"""Vendors' own files, and those that are made up line by line: all are read, and what they say is what they mean."""

from __future__ import annotations

import tempfile
from pathlib import Path

import canopen
import pytest
from eds_corpus import OWN_EDS, own_text
from hypothesis import given, settings
from hypothesis import strategies as st
from real_eds import MISSING, real_eds_files

from schwung.errors import InputError
from schwung.fieldbus.eds import EdsFile, read_eds

NODE = 5
EXAMPLES = 150

_real = real_eds_files()
every_real_file = pytest.mark.parametrize(
    "path",
    _real or [pytest.param(Path(), marks=pytest.mark.skip(reason=MISSING))],
    ids=lambda path: path.stem,
)


def _variables(
    dictionary: canopen.ObjectDictionary,
) -> dict[tuple[int, int], canopen.objectdictionary.ODVariable]:
    found = {}
    for index, entry in dictionary.indices.items():
        held = getattr(entry, "subindices", {0: entry})
        found |= {(index, subindex): variable for subindex, variable in held.items() if index >= 0x1000}
    return found


@every_real_file
def test_a_vendors_file_means_what_canopen_reads_in_it_or_more(path: Path, tmp_path: Path) -> None:
    """Nothing is lost by the repair: every object that canopen finds by itself is there, with type, access, value."""
    plain = tmp_path / "plain.eds"
    plain.write_bytes(path.read_bytes().decode("cp1252").encode("utf-8"))
    alone = _variables(canopen.import_od(str(plain), NODE))
    ours = _variables(read_eds(path, NODE).dictionary)
    assert set(alone) <= set(ours)
    for key, theirs in alone.items():
        mine = ours[key]
        assert (mine.data_type, mine.access_type, mine.pdo_mappable) == (
            theirs.data_type, theirs.access_type, theirs.pdo_mappable), key  # fmt: skip
        if theirs.default is not None:
            bits = max(8, len(theirs))
            same = mine.default == theirs.default
            assert same or (theirs.default - mine.default) % (1 << bits) == 0, (
                key
            )  # two's complement, read as meant


@every_real_file
def test_a_vendors_file_is_read_with_few_words(path: Path) -> None:
    file = read_eds(path, NODE)
    assert len(file.description.objects) > 70
    assert not file.unusable
    lines = path.read_bytes().decode("cp1252").splitlines()
    for warning in file.warnings:
        assert 1 <= warning.line <= len(lines)
        assert warning.remedy
        assert warning.section.lower() in ("", *_section_above(lines, warning.line)), warning


def _section_above(lines: list[str], number: int) -> tuple[str, ...]:
    names = [line.strip()[1:-1].lower() for line in lines[:number] if line.startswith("[")]
    return tuple(names[-1:])


def test_what_is_odd_in_the_vendors_files_is_told() -> None:
    told = {path.parent.name: [str(w) for w in read_eds(path, NODE).warnings] for path in _real}
    if not told:
        pytest.skip(MISSING)
    assert any("byte 0x94" in text for text in told["faulhaber-cc-3150-51v"])
    assert any("NULL" in text for text in told["wittenstein-simco"])
    assert any("[6065]" in text and "INTEGER32" in text for text in told["zeroerr-erob"])
    assert told["maxon-epos4-50-15"] == told["elmo-gold"] == told["trinamic-tmcm1636"] == []


# ── made up ──────────────────────────────────────────────────────────────────────────────────────────────────────

_OWN = own_text()
_LINES = _OWN.splitlines()
_WORDS = st.sampled_from([
    "", "=", "[", "]", "[6041]", "[6041sub1]", "[6041subFF]", "[FFFF]", "[1018Name]", "[1018Value]",
    "DataType=", "DataType=0x9", "DataType=0x0F", "DataType=8", "DataType=99999999999999", "ObjectType=2",
    "ObjectType=9", "CompactSubObj=254", "SubNumber=-1", "DefaultValue=$NODEID+$NODEID",
    "DefaultValue=((((((((((", "DefaultValue=0x", "DefaultValue=-0x80000001", "DefaultValue=1e999",
    "DefaultValue=nan", "LowLimit=0xFFFFFFFFFFFFFFFFFFFFFF", "HighLimit=$NODEID", "AccessType=rw",
    "ParameterName=", "ParameterName=%(x)s", "Lines=-3", "Line1=", "SupportedObjects=0x3", "NrOfEntries=3",
    "1=", "255=1", "NodeID=0", "Baudrate=x", "Dummy0001=2", ";", "\x00", "\ufeff", "[ ]", "[]", "=x", "x:y",
    "Granularity=0x", "Factor=x",
])  # fmt: skip
_LINE = st.one_of(_WORDS, st.text(max_size=30), st.sampled_from(_LINES))
_CHANGES = st.lists(
    st.tuples(st.sampled_from(["put", "drop", "replace", "double", "swap"]), st.integers(0, len(_LINES)), _LINE),
    min_size=1, max_size=25,
)  # fmt: skip


def _changed(changes: list[tuple[str, int, str]]) -> str:
    lines = list(_LINES)
    for what, at, line in changes:
        place = at % max(len(lines), 1)
        if what == "put" or not lines:
            lines.insert(place, line)
        elif what == "drop":
            del lines[place]
        elif what == "replace":
            lines[place] = line
        elif what == "double":
            lines.insert(place, lines[place])
        else:
            lines[place], lines[-1] = lines[-1], lines[place]
    return "\n".join(lines)


def _read(content: bytes) -> EdsFile | None:
    """Read; only our own error may come out, and it has to help."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fuzzed.eds"
        path.write_bytes(content)
        found = _read_or_refuse(path)
    if isinstance(found, InputError):
        assert str(path) in found.place
        assert found.remedy
        return None
    last = content.count(b"\n") + content.count(b"\r") + 1
    assert all(0 <= w.line <= last and w.problem and w.remedy for w in found.warnings)
    assert set(_variables(found.dictionary)) == {(v.index, v.subindex) for v in found.description.variables()}
    return found


def _read_or_refuse(path: Path) -> EdsFile | InputError:
    try:
        return read_eds(path, NODE)
    except InputError as refusal:
        return refusal


@settings(max_examples=EXAMPLES, deadline=None)
@given(_CHANGES)
def test_lines_changed_by_chance_are_read_or_refused(changes: list[tuple[str, int, str]]) -> None:
    _read(_changed(changes).encode("utf-8", errors="surrogatepass"))


@settings(max_examples=EXAMPLES, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, len(_OWN)), st.binary(max_size=4)), min_size=1, max_size=20),
    st.integers(0),
)
def test_bytes_changed_by_chance_are_read_or_refused(changes: list[tuple[int, bytes]], cut: int) -> None:
    content = bytearray(_OWN.encode())
    for at, data in changes:
        content[at : at + len(data)] = data
    _read(bytes(content[: cut % (2 * len(content))]))


@settings(max_examples=EXAMPLES, deadline=None)
@given(
    st.one_of(
        st.binary(max_size=300),
        st.lists(_LINE, max_size=20).map(lambda lines: "\n".join(lines).encode(errors="replace")),
    )
)
def test_anything_is_read_or_refused(content: bytes) -> None:
    _read(content)


def test_our_own_file_is_read_without_a_word() -> None:
    assert read_eds(OWN_EDS, NODE).warnings == ()
    assert _read(_OWN.encode()) is not None


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing.eds"):
        with pytest.raises(InputError, match="cannot be read"):
            read_eds(path, NODE)
    huge = tmp_path / "huge.eds"
    with huge.open("wb") as file:
        file.truncate(40 << 20)
    with pytest.raises(InputError, match="larger than"):
        read_eds(huge, NODE)
