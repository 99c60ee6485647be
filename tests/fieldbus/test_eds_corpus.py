"""Every broken file of the corpus is read with a warning at its line, or refused with line and remedy."""

from pathlib import Path

import pytest
from eds_corpus import VARIANTS, Variant, own_text

from schwung.errors import InputError
from schwung.fieldbus.eds import EdsFile, read_eds

NODE = 5


def _write(variant: Variant, folder: Path) -> tuple[Path, str]:
    made = variant.edit(own_text())
    content = made if isinstance(made, bytes) else made.encode()
    path = folder / "variant.eds"
    path.write_bytes(content)
    return path, made if isinstance(made, str) else made.decode("latin-1").replace("\0", "")


def _line_of(text: str, at: str) -> int | None:
    """Number of the line where a text stands (the last time), by any line end; None where nothing is asked for."""
    if not at:
        return None
    plain = text.replace("\r\r\n", "\n\n").replace("\r\n", "\n").replace("\r", "\n")
    return plain[: plain.rindex(at)].count("\n") + 1


def _means(file: EdsFile, variant: Variant) -> None:
    for (index, subindex), wanted in variant.means.items():
        found = file.variable(index, subindex)
        assert found is not None, f"{index:04X}:{subindex:02X} is lost"
        for key, value in wanted.items():
            if key in ("default", "configured"):
                held = getattr(found, key)
                assert (None if held is None else held.raw) == value
            elif key == "offset":
                assert found.default is not None
                assert found.default.offset == value
            else:
                assert getattr(found, key) == value
        parameter = file.find(index, subindex)
        assert parameter is not None
        entry = file.dictionary.indices[index]
        told = entry.subindices[subindex] if hasattr(entry, "subindices") else entry
        if "default" in wanted:
            assert told.default == wanted["default"]  # canopen has understood it likewise


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_a_broken_file_is_read_or_refused_with_line_and_remedy(variant: Variant, tmp_path: Path) -> None:
    path, text = _write(variant, tmp_path)
    expected = variant.expected
    line = _line_of(text, expected.at)
    if expected.kind == "refused":
        with pytest.raises(InputError, match=expected.words) as refusal:
            read_eds(path, NODE)
        assert str(path) in refusal.value.place
        assert refusal.value.remedy
        if line is not None:
            assert refusal.value.place == f"{path}:{line}"
        return
    file = read_eds(path, NODE)
    told = [f"{warning}" for warning in file.warnings]
    assert all(warning.remedy for warning in file.warnings)
    if expected.kind == "quiet":
        assert told == []
    else:
        fitting = [w for w in file.warnings if expected.words in f"{w}" and (line is None or w.line == line)]
        assert fitting, f"nothing about line {line} in {told}"
    if expected.kind == "lacks":
        with pytest.raises(InputError, match=expected.words) as refusal:
            file.parameter(*expected.needed)
        assert f"{path}:{line}" in refusal.value.place
        assert refusal.value.remedy
    _means(file, variant)


def test_the_corpus_is_large_and_its_names_are_unique() -> None:
    assert len({variant.name for variant in VARIANTS}) == len(VARIANTS) >= 60
