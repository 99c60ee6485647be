"""A drive made of a hand-written EDS and profile: what its profile names does what the profile says it does."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest
from canopen_rig import Aborted, Rig

from schwung_sim.drives.roles import find_profile, read_profile, read_roles
from schwung_sim.errors import BenchError

PROFILE = """
version = 1
family = "hand-made"
name = "A drive of our own"
verified = "bench"
eds = "drive.eds"
modes = {{ pp = 1 }}
pdo = []
[quantities.position]
object = "2100:00"
demand = "2101:00"
unit = "literal"
scale = {scale}
[quantities.speed]
object = "606C:00"
unit = "position_per_second"
[quantities.torque]
object = "2102:00"
unit = "literal"
scale = 0.5
{more}
"""
TYPES = {"i1": 2, "i2": 3, "i4": 4, "u1": 5, "u2": 6, "u4": 7, "f4": 8, "domain": 15}


def eds_of(objects: dict[str, tuple[str, str]]) -> str:
    """{"6040": ("u2", "rw"), …} as an EDS; "2000:3" is a record with three elements."""
    text = ""
    for name, (kind, access) in objects.items():
        index, _, elements = name.partition(":")
        common = f"DataType={TYPES[kind]}\nAccessType={access}\nPDOMapping=1\n"
        if elements:
            text += f"[{index}]\nObjectType=8\n[{index}sub0]\nDataType=5\nAccessType=ro\n"
            text += "".join(f"[{index}sub{n:X}]\n{common}" for n in range(1, int(elements) + 1))
        else:
            text += f"[{index}]\nObjectType=7\n{common}"
    return text


BASE = {
    "6040": ("u2", "rw"), "6041": ("u2", "ro"), "6060": ("i1", "rw"), "6061": ("i1", "ro"), "2100": ("i4", "ro"),
    "2101": ("i4", "rw"), "606C": ("i4", "ro"), "2102": ("i2", "ro"), "6081": ("u4", "rw"), "6083": ("u4", "rw"),
    "6084": ("u4", "rw"),
}  # fmt: skip


def rig_of(tmp_path: Path, more: str = "", scale: float = 0.001, **objects: tuple[str, str]) -> Rig:
    extra = {name.removeprefix("o").replace("_", ":"): value for name, value in objects.items()}
    (tmp_path / "drive.eds").write_text(eds_of(BASE | extra))
    (tmp_path / "profile.toml").write_text(PROFILE.format(more=more, scale=scale))
    return Rig(profile=tmp_path)


def move(rig: Rig, target: int, speed: int = 20_000, rate: int = 500_000, syncs: int = 300) -> None:
    """A stroke of the drive's own, in its units."""
    rig.write(0x2101, 0, target, 4)
    rig.write(0x6081, 0, speed, 4)
    rig.write(0x6083, 0, rate, 4)
    rig.write(0x6084, 0, rate, 4)
    rig.control(0x1F)
    rig.sync(syncs)
    rig.control(0x0F)


@pytest.mark.parametrize("scale", [0.001, -0.001, 1e-5])
def test_position_and_speed_are_in_the_profiles_unit(scale: float, tmp_path: Path) -> None:
    rig = rig_of(tmp_path, scale=scale)
    rig.enable(1)
    move(rig, round(0.7 / scale), speed=round(5 / abs(scale)), rate=round(100 / abs(scale)), syncs=800)
    assert rig.axis.position_rad == pytest.approx(0.7, abs=0.003)
    assert rig.read(0x2100, signed=True) * scale == pytest.approx(rig.axis.position_rad, abs=abs(scale))


def test_what_the_eds_lacks_is_refused_and_works_all_the_same(tmp_path: Path) -> None:
    rig = rig_of(tmp_path)
    for index in (0x605A, 0x6064, 0x6085, 0x60B2, 0x1016, 0x2F00):
        with pytest.raises(Aborted, match="0x06020000"):
            rig.read(index)
    rig.enable(1)
    rig.write(0x2101, 0, 3000, 4)
    rig.control(0x1F)
    rig.sync(100)
    assert rig.control(0x02) == 0x07  # quick stop, by the standard's own 605A …
    rig.sync(600)
    assert rig.state == 0x40  # … which is 2: then switch on disabled


def test_modes_that_the_profile_lacks_are_refused(tmp_path: Path) -> None:
    rig = rig_of(tmp_path)
    with pytest.raises(Aborted, match="0x06090030"):
        rig.write(0x6060, 0, 8, 1)


def test_torque_may_be_a_real_number(tmp_path: Path) -> None:
    more = '[quantities.torque_added]\nobject = "2103:00"\nunit = "literal"\nscale = 2.0'
    rig = rig_of(tmp_path, more, o2103=("f4", "rw"))
    rig.enable(1)
    rig.ask(struct.pack("<BHBf", 0x23, 0x2103, 0, 1.25))
    rig.sync(3)
    assert rig.axis.torque_demand_nm != 0
    rig.sync(1)
    shown = rig.read(0x2102, signed=True) * 0.5
    assert shown == pytest.approx(rig.axis.torque_nm, abs=0.26)


TRACE = """
[trace]
base_rate_hz = {base}
divider = "2200:01"
length = "2200:02"
max_samples = 500
control = {{ object = "2200:03", arm = 7, stop = 4 }}
status = {{ object = "2200:04", full = 0x20, running = 0x10, mask = 0xF0 }}
trigger = "{trigger}"
layout = "{layout}"
"""
ROWS = """columns = [{ quantity = "position", type = "INTEGER32" }, { quantity = "torque", type = "INTEGER16" }]
data = "2201:00"
"""
TRACED = {
    "o2200_4": ("u2", "rw"),
    "o2201": ("domain", "ro"),
    "o2202": ("domain", "ro"),
    "o2203": ("u2", "rw"),
}


def traced(
    tmp_path: Path, base: float, columns: str, trigger: str = "motion_start", layout: str = "rows"
) -> Rig:
    more = TRACE.format(base=base, trigger=trigger, layout=layout) + columns
    rig = rig_of(tmp_path, more, **TRACED)
    rig.enable(1)
    return rig


def upload(rig: Rig, index: int) -> bytes:
    return bytes(rig.servo.dictionary.upload(index, 0))


@pytest.mark.parametrize(("base", "divider"), [(8000, 4), (2500, 1), (16000, 3)])
def test_a_trace_has_the_profiles_rate_whatever_the_controllers_is(
    base: float, divider: int, tmp_path: Path
) -> None:
    rig = traced(tmp_path, base, ROWS)
    rig.write(0x2200, 1, divider, 2)
    rig.write(0x2200, 2, 200, 2)
    rig.write(0x2200, 3, 7, 2)
    assert rig.read(0x2200, 4) == 0
    positions: list[float] = []
    rig.servo.on_advance = lambda: positions.append(rig.axis.position_rad)
    move(rig, 500)
    assert rig.read(0x2200, 4) == 0x20
    rows = np.frombuffer(upload(rig, 0x2201), "<i4,<i2")
    assert rows.size == 200
    instants = np.arange(200) * divider / base
    by_sync = np.interp(instants, np.arange(len(positions)) * 1e-3 + 1e-3, positions)
    assert rows["f0"] * 0.001 == pytest.approx(by_sync, abs=0.0035)
    assert np.max(rows["f1"]) * 0.5 > 2


def test_a_trace_that_starts_at_once_and_is_stopped_keeps_what_it_has(tmp_path: Path) -> None:
    rig = traced(tmp_path, 8000, ROWS, trigger="immediate")
    rig.write(0x2200, 1, 8, 2)
    rig.write(0x2200, 2, 400, 2)
    rig.write(0x2200, 3, 7, 2)
    rig.sync(50)
    assert rig.read(0x2200, 4) == 0x10
    rig.write(0x2200, 3, 4, 2)
    assert rig.read(0x2200, 4) not in (0x10, 0x20)
    assert len(upload(rig, 0x2201)) == 50 * 6
    with pytest.raises(Aborted, match="0x06090030"):
        rig.write(0x2200, 3, 5, 2)


def test_columns_are_read_one_by_one_and_hold_what_was_selected(tmp_path: Path) -> None:
    columns = """columns = [
        { quantity = "position", type = "INTEGER32", data = "2201:00" },
        { quantity = "speed", type = "REAL32", scale = 0.1, data = "2202:00", selector = "2203:00", selection = 3 },
    ]
    """
    rig = traced(tmp_path, 8000, columns, layout="columns")
    for selection, moving in ((0, False), (3, True)):
        rig.write(0x2203, 0, selection, 2)
        rig.write(0x2200, 1, 8, 2)
        rig.write(0x2200, 2, 100, 2)
        rig.write(0x2200, 3, 7, 2)
        move(rig, 500 if moving else 250)
        assert len(upload(rig, 0x2201)) == 400
        speed = np.frombuffer(upload(rig, 0x2202), "<f4") * 0.1
        assert (np.max(np.abs(speed)) > 1) == moving
        rig.write(0x2200, 3, 4, 2)
        rig.sync(300)


def test_the_generator_takes_its_units_and_its_values_from_the_profile(tmp_path: Path) -> None:
    more = """[generator]
    amplitude = { object = "2300:01", unit = "literal", scale = 0.25 }
    frequency = { object = "2300:02", scale = 0.5 }
    control = { object = "2300:03", off = 9, on = 5 }
    """
    rig = rig_of(tmp_path, more, o2300_3=("u2", "rw"))
    rig.enable(1)
    rig.write(0x2300, 1, 40, 2)
    rig.write(0x2300, 2, 100, 2)
    rig.write(0x2300, 3, 5, 2)
    settings = rig.axis.settings
    assert (settings.generator_amplitude_nm, settings.generator_frequency_hz) == (10.0, 50.0)
    torques = []
    rig.servo.on_advance = lambda: torques.append(rig.axis.torque_demand_nm)
    rig.sync(100)
    assert np.ptp(torques[60:]) > 2
    with pytest.raises(Aborted, match="0x06090030"):
        rig.write(0x2300, 3, 1, 2)
    rig.write(0x2300, 3, 9, 2)
    torques.clear()
    rig.sync(400)
    assert np.ptp(torques[-20:]) < 0.2


def test_an_inertia_of_everything_is_told_with_the_motors_constant(tmp_path: Path) -> None:
    more = """[export.scalar]
    object = "2400:01"
    scale_kgm2 = 1e-9
    per = "2400:02"
    of = "total"
    """
    rig = rig_of(tmp_path, more, o2400_2=("u4", "rw"))
    assert rig.read(0x2400, 2) == 1000  # so that a count is 1e-6 kg·m²
    rig.write(0x2400, 1, 112_000, 4)
    settings = rig.axis.settings
    assert settings.feed_forward_mode == 1
    assert settings.scalar_inertia_kgm2 + settings.rotor_inertia_kgm2 == pytest.approx(0.112)
    rig.write(0x2400, 1, 0, 4)
    assert rig.axis.settings.feed_forward_mode == 0


def test_harmonics_become_the_inertia_over_angle(tmp_path: Path) -> None:
    more = """[export.harmonics]
    offset = { object = "2500:01", scale = 1e-4 }
    amplitudes = "2501:00"
    amplitude_scale_kgm2 = 1e-4
    phases = "2502:00"
    phase_scale_rad = 1e-3
    orders = 3
    enable = { object = "2500:02", value = 2 }
    """
    rig = rig_of(tmp_path, more, o2500_2=("u2", "rw"), o2501_3=("i2", "rw"), o2502_3=("i2", "rw"))
    rig.write(0x2500, 1, 1000, 2)
    rig.write(0x2501, 2, 300, 2)
    rig.write(0x2502, 2, 500, 2)
    assert rig.axis.settings.feed_forward_mode == 0
    rig.write(0x2500, 2, 2, 2)
    settings = rig.axis.settings
    assert settings.feed_forward_mode == 2
    angles = settings.table_start_rad + settings.table_step_rad * np.arange(len(settings.table_inertia_kgm2))
    expected = 0.1 + 0.03 * np.cos(2 * angles - 0.5)
    assert np.asarray(settings.table_inertia_kgm2) == pytest.approx(expected)
    assert angles[0] <= -2 * math.pi
    assert angles[-1] >= 2 * math.pi


def test_torque_that_the_host_plays_is_added_to_what_is_injected(tmp_path: Path) -> None:
    more = """[quantities.torque_added]
    object = "2103:00"
    unit = "literal"
    scale = 0.1
    [export.host_played]
    object = "2104:00"
    unit = "literal"
    scale = 0.2
    """
    rig = rig_of(tmp_path, more, o2103=("i2", "rw"), o2104=("i2", "rw"))
    added: list[float] = []
    rig.axis.set_torque_offset = added.append  # type: ignore[method-assign]  # only what is asked of it is looked at
    rig.write(0x2103, 0, 30, 2)
    rig.write(0x2104, 0, -5, 2)
    rig.write(0x2103, 0, 0, 2)
    assert added == pytest.approx([3.0, 2.0, -1.0])


def test_gains_are_those_of_the_benchs_machine_until_somebody_changes_them(tmp_path: Path) -> None:
    more = '[control]\nspeed_gain = { object = "2600:00", scale = 0.01 }'
    rig = rig_of(tmp_path, more, o2600=("u2", "rw"))
    assert rig.read(0x2600) == 700
    assert rig.axis.settings.speed_gain_nms_rad == pytest.approx(7.0)
    rig.write(0x2600, 0, 350, 2)
    assert rig.axis.settings.speed_gain_nms_rad == pytest.approx(3.5)


def test_commands_are_not_stored(tmp_path: Path) -> None:
    more = '[quantities.torque_added]\nobject = "2103:00"\nunit = "literal"\nscale = 0.1'
    rig = rig_of(tmp_path, more, o2103=("i2", "rw"), o1010_1=("u4", "rw"))
    rig.write(0x2103, 0, 30, 2)
    rig.write(0x6081, 0, 77, 4)
    rig.write(0x1010, 1, 0x65766173, 4)
    rig.nmt(0x81)
    assert rig.read(0x2103) == 0
    assert rig.read(0x6081) == 77


def test_a_profile_that_extends_another_has_its_parts(tmp_path: Path) -> None:
    base = tmp_path / "base"
    base.mkdir()
    (base / "drive.eds").write_text(eds_of(BASE))
    (base / "profile.toml").write_text(PROFILE.format(more="", scale=0.001))
    above = tmp_path / "above"
    above.mkdir()
    (above / "profile.toml").write_text(
        'extends = "../base"\n[quantities.torque]\nunit = "rated_torque"\nrated_torque_scale = 1e-6\n'
    )
    content, eds = read_profile(find_profile(above))
    roles = read_roles(content)
    assert eds == base / "drive.eds"
    assert roles.torque is not None
    assert (roles.torque.object, roles.torque.unit, roles.torque.scale) == (0x210200, "rated_torque", None)
    assert roles.position.scale == 0.001


def test_profiles_that_cannot_be_acted_out_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="neither a family nor a file"):
        find_profile("no-such-drive")
    (tmp_path / "profile.toml").write_text("version = 1\n[quantities]\n")
    with pytest.raises(BenchError, match="profile check"):
        read_roles(read_profile(tmp_path / "profile.toml")[0])
    (tmp_path / "profile.toml").write_text("version = ")
    with pytest.raises(BenchError, match="cannot be read"):
        read_profile(tmp_path / "profile.toml")
