"""What can be said about a drive, and what cannot; every word of it is told where a user looks for it."""

import re
from pathlib import Path

import pytest
from canopen_rig import Rig

from schwung_sim import faults
from schwung_sim.bench import Bench
from schwung_sim.errors import BenchError
from schwung_sim.faults import Fault, parse_faults
from schwung_sim.traits import TRAITS

DOCS = Path(__file__).parents[2] / "docs" / "bench.md"


def test_begin_and_end() -> None:
    assert parse_faults(
        "sto@0.5..0.8, local@..0.1,sto-fault=0xFF20@on+0.2..0.3,brake,set-up=0x607C00:-5000"
    ) == (
        Fault("sto", 0x5091, at_s=0.5, until_s=0.8, extra=faults.SDO_GENERAL_ERROR),
        Fault("local", 0, until_s=0.1, extra=faults.SDO_GENERAL_ERROR),
        Fault(
            "sto-fault", 0xFF20, at_s=0.2, until_s=0.3, after_power_on=True, extra=faults.SDO_GENERAL_ERROR
        ),
        Fault("brake", 0.15, extra=faults.SDO_GENERAL_ERROR),
        Fault("set-up", 0x607C00, extra=-5000),
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("late-controlword", "numbers cannot be read"),
        ("late-controlword=0", "takes no time"),
        ("controlword-task=-0.1", "negative"),
        ("brake@0.1..0.2", "does not end so"),
        ("sto@0.5..0.4", "does not end so"),
        ("sto@0.5..", "numbers cannot be read"),
        ("set-up=0x607C00", "names no value"),
        ("set-up=0x607C00:1@0.5", "how a drive is made"),
        ("torque-polarity=8", "not one of its values"),
        ("store-power-cut=3", "not one of its values"),
        ("stö", "no such fault"),
    ],
)
def test_nonsense_is_told_before_anything_runs(text: str, said: str) -> None:
    with pytest.raises(BenchError, match=said):
        Bench(channel="nonsense", faults=text)


EXAMPLES = re.findall(r"^    ([a-z]\S+)  ", faults.__doc__ or "", re.MULTILINE)


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_documented_example_begins_and_ends(example: str) -> None:
    (fault,) = parse_faults(example)
    rig = Rig(faults=example)
    rig.sync(1000)
    assert rig.axis.time_s == pytest.approx(1.0)
    assert fault.kind in faults.KINDS


@pytest.mark.parametrize("kind", sorted(TRAITS))
def test_every_trait_is_documented(kind: str) -> None:
    assert kind in (faults.__doc__ or "")
    assert f"`{kind}" in DOCS.read_text()
