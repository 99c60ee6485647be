"""The tool against Modbus drives made of literal frames."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from golden_modbus import AKD, BENCH, DELTA, LEXIUM, GoldenModbus
from golden_registers import GoldenLine, connected

from schwung.errors import InputError
from schwung.fieldbus.drive import Parameter, ParameterValue
from schwung.fieldbus.modbus import ModbusDrive
from schwung.fieldbus.profile import ModbusProfile, list_profiles, load_profile

ALL = (DELTA, LEXIUM, AKD, BENCH)
EXACT = 1e-12  # decimal literals of 16 digits


def family(golden: GoldenModbus) -> str:
    return golden.family


def modbus_profile(name: str | Path) -> ModbusProfile:
    profile = load_profile(name)
    assert isinstance(profile, ModbusProfile)
    return profile


def line(golden: GoldenModbus) -> GoldenLine:
    frames = {e.request: e.response for e in (*golden.read, *golden.written)}
    return GoldenLine(frames, tcp=golden.tcp)


def parameter(drive: ModbusDrive, register: int, value: int) -> Parameter:
    """As the profile has it; of registers that only the manual's example names, 32 bits, or 64 for what needs them."""
    try:
        return drive.parameter(register)
    except InputError:
        wide = "INTEGER64" if register == 230 else "INTEGER32" if value < 0 else "UNSIGNED32"
        return Parameter(register, 0, wide, space="register")


def test_every_modbus_family_has_its_golden_drive() -> None:
    assert {g.family for g in ALL} == {p.family for p in list_profiles() if isinstance(p, ModbusProfile)}


@pytest.mark.parametrize("golden", ALL, ids=family)
def test_frames_are_the_manuals_both_ways(golden: GoldenModbus) -> None:
    wire = line(golden)
    with connected(wire, modbus_profile(golden.family)) as drive:
        for exchange in golden.read:
            found = drive.read(parameter(drive, exchange.register, exchange.value))
            assert found.raw == exchange.value, exchange.source
        for exchange in golden.written:
            drive.write([ParameterValue(parameter(drive, exchange.register, exchange.value), exchange.value)])
            assert wire.requests[-1] == bytes.fromhex(exchange.request), exchange.source


@pytest.mark.parametrize("golden", ALL, ids=family)
def test_the_profile_uses_these_registers(golden: GoldenModbus) -> None:
    used = {place: ref.index for place, ref in modbus_profile(golden.family).refs()}
    assert {place: used.get(place) for place in golden.places} == golden.places
    assert modbus_profile(golden.family).modes in ({}, {"pp": 1})  # CiA 402-2, 6060: 1 is profile position


@pytest.mark.parametrize("golden", ALL, ids=family)
def test_units_and_state_are_the_manuals(golden: GoldenModbus) -> None:
    with connected(line(golden), modbus_profile(golden.family)) as drive:
        for name in ("position_rad", "speed_rad_s", "torque_nm"):
            told = getattr(golden, name)
            wanted = math.nan if told is None else told
            assert getattr(drive.scales, name) == pytest.approx(wanted, rel=EXACT, nan_ok=True), name
        state = drive.state()
        assert state.cia402 == golden.state
        stands = math.nan if golden.stands_rad is None else golden.stands_rad
        assert state.position_rad == pytest.approx(stands, rel=EXACT, nan_ok=True)


def test_a_drive_in_the_other_word_order_is_no_bench_drive() -> None:
    swapped = {"03 00 00 00 02": "03 04 4E 47 53 57", "03 00 02 00 02": "03 04 4D 42 00 00"}
    wire = GoldenLine(swapped | {"03 00 04 00 02": "03 04 00 07 00 00"}, tcp=True)
    with (
        pytest.raises(InputError, match="not 0x53574e47"),
        connected(wire, modbus_profile(BENCH.family)),
    ):
        pass


def test_the_akds_hint_gives_the_manuals_example(tmp_path: Path) -> None:
    """MODBUS.PSCALE = 16, MODBUS.PIN = 5215189, MODBUS.POUT = 500000: PL.FB is mrad, and 3495 was 36462 counts of 65536
    (AKD user guide, May 2014, page 880)."""
    per_count = 2 * math.pi / 2**16 * 5215189 / 500000
    file = tmp_path / "profile.toml"
    file.write_text(
        f'version = 1\nprotocol = "modbus"\nextends = "kollmorgen-akd"\n'
        f'[quantities.position]\nunit = "literal"\nscale = {per_count!r}\n'
        '[sources]\n"quantities.position" = "its hint"\n'
    )
    with connected(line(AKD), modbus_profile(file)) as drive:
        assert drive.scales.position_rad == pytest.approx(0.001, rel=1e-7)  # PIN and POUT are rounded
        assert drive.state().position_rad == pytest.approx(36462 / 65536 * 2 * math.pi, abs=0.001)
