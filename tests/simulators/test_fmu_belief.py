"""An FMU as the belief: what it leaves out of a recording is named as with a machine file; strangers' FMUs, too.

Recordings are the virtual machine room's, or simulated and given noise; the FMUs are our own exports, or small ones in
C that `foreign_fmus.py` writes in other units and signs.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from schwung.cli import main
from schwung.drivetrain import InertiaTable, Machine, load_machine, simulate
from schwung.drivetrain.machine import Control, Coupling, Load, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.errors import InputError
from schwung.explain.explain import explain
from schwung.explain.values import Explanation
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session, read_session
from schwung.simulators.belief import fmu_belief
from schwung.simulators.fmu import write_fmu
from schwung_sim.sealed import CaseWishes, draw_case, read_labels, write_case

pytest.importorskip("fmpy")
foreign = pytest.importorskip("foreign_fmus")
pytestmark = pytest.mark.skipif(
    not any(shutil.which(name) for name in ("cc", "gcc", "clang")), reason="no C compiler"
)

OURS = """\
[torque]
variable = "torque"
[position]
variable = "motor_angle"
[speed]
variable = "motor_speed"
[start]
position = "start_angle_rad"
"""
TWO_MASSES = """\
[torque]
variable = "tau"
sign = -1
[position]
variable = "phi"
[speed]
variable = "n"
unit = "rpm"
"""
INVERSE = """\
[torque]
variable = "tau"
[position]
variable = "a"
[speed]
variable = "w"
[acceleration]
variable = "alpha"
"""
BROKEN = """\
[torque]
variable = "tau"
[position]
variable = "phi"
[speed]
variable = "w"
"""


def against(session: Session, fmu: Path, mapped: str) -> tuple[Machine, Explanation]:
    """The stand-in, and what the FMU leaves out."""
    place = fmu.with_name("map.toml")
    place.write_text(mapped, encoding="utf-8")
    belief = fmu_belief(session, fmu, place)
    return belief.machine, explain(session, belief.machine, twin=belief.twin)


def drawn(folder: Path, seed: int, **wishes: Any) -> tuple[Session, Machine, dict[str, Any]]:
    """A recorded session of the virtual machine room, the belief, and what it conceals."""
    write_case(draw_case(seed, CaseWishes(**wishes)), folder, "0000")
    place = folder / "sessions" / "0000"
    (label,) = read_labels(folder)
    return read_session(place / "session.h5"), load_machine(place / "machine.toml"), dict(label)


def machine_of(plant: Any, *, rigid: bool = False) -> Machine:
    """The machine of a foreign FMU, under a controller."""
    angle = np.linspace(-0.5, 3.5, 401)
    table = InertiaTable(angle, plant.base + plant.swing * np.sin(angle) ** 2)
    return Machine(
        name="foreign",
        motor=Motor(inertia_kgm2=plant.rotor, viscous_friction_nms=0.0, peak_torque_nm=233.0),
        coupling=None if rigid else Coupling(stiffness_nm_rad=plant.k, damping_nms=plant.d),
        load=Load(inertia_table=table),
        control=Control(
            position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=8e-3, sample_rate_hz=8000.0
        ),
    )


def recorded(machine: Machine) -> Session:
    """Strokes of two motion times with and without injection, at 1 kHz, with noise."""
    chance = np.random.default_rng(5)
    runs = []
    for duration in (0.35, 0.25):
        motion = Motion(
            kind="poly5", distance_rad=3.0, duration_s=duration, start_time_s=0.05, returns=True, dwell_s=0.05
        )
        time = np.arange(round(1000 * (2 * duration + 0.17))) / 1000
        for role, repeats in (("reference", 2), ("excited", 1)):
            sine = Excitation(frequency_hz=50, amplitude_nm=25.0)
            added = sine.torque(time) if role == "excited" else np.zeros_like(time)
            moved = simulate(machine, motion.demand(time), time, added)
            noise = chance.standard_normal((3, repeats, time.size))
            runs += [
                Run(
                    role=role,  # type: ignore[arg-type]
                    repeat=repeat,
                    sample_rate_hz=1000.0,
                    time_s=time,
                    position_rad=moved.position_rad + 2e-6 * noise[0, repeat],
                    speed_rad_s=moved.speed_rad_s + 0.02 * noise[1, repeat],
                    torque_nm=moved.torque_nm + 0.1 * noise[2, repeat],
                    motion=motion,
                    excitation=sine if role == "excited" else None,
                )
                for repeat in range(repeats)
            ]
    return Session(runs=tuple(runs), created="2026-01-01T00:00:00Z", source="test")


def test_friction_and_payload_are_named_against_an_fmu_as_with_a_machine_file(tmp_path: Path) -> None:
    session, believed, label = drawn(tmp_path, 501, kind="two", among=("stribeck_friction", "load_inertia"))
    fmu = write_fmu(believed, tmp_path / "model.fmu").path
    stand_in, found = against(session, fmu, OURS)
    assert stand_in.coupling is not None
    assert believed.coupling is not None
    assert stand_in.coupling.stiffness_nm_rad == pytest.approx(believed.coupling.stiffness_nm_rad, rel=0.02)
    hidden = {effect["physics"]: effect["parameters"] for effect in label["effects"]}
    named = {finding.physics: finding.parameters for finding in found.findings}
    assert found.verdict == "explained"
    assert set(named) == set(hidden) == {"stribeck_friction", "load_inertia"}
    for key in ("coulomb_torque_nm", "breakaway_torque_nm"):
        assert named["stribeck_friction"][key].value == pytest.approx(
            hidden["stribeck_friction"][key], rel=0.05
        )
    assert named["load_inertia"]["scale"].value == pytest.approx(hidden["load_inertia"]["scale"], rel=0.005)


@pytest.mark.parametrize("fmi", [2, 3])
def test_what_was_learned_is_consistent_with_the_session_that_it_came_from(fmi: Any, tmp_path: Path) -> None:
    session, believed, _ = drawn(tmp_path, 401, among=("coulomb_friction",))
    learned = explain(session, believed)
    assert [finding.physics for finding in learned.findings] == ["coulomb_friction"]
    fmu = write_fmu(learned.machine, tmp_path / "model.fmu", fmi=fmi).path
    _, again = against(session, fmu, OURS)
    assert again.verdict == "consistent"
    assert again.fit.before.torque_rmse_nm < 1.2 * learned.fit.after.torque_rmse_nm


def test_a_stranger_s_model_exchange_in_degrees_and_rpm_the_other_way_round(tmp_path: Path) -> None:
    plant = foreign.Plant()
    fmu = foreign.two_masses(tmp_path, plant)
    machine = machine_of(plant)
    stand_in, found = against(recorded(machine), fmu, TWO_MASSES)
    assert stand_in.coupling is not None
    assert stand_in.coupling.stiffness_nm_rad == pytest.approx(plant.k, rel=0.03)
    assert stand_in.motor.inertia_kgm2 == pytest.approx(plant.rotor, rel=0.03)
    assert found.verdict == "consistent"
    rubs = PhysicsTerm.model_validate({"name": "coulomb_friction", "torque_nm": 4.0})
    _, found = against(recorded(machine.model_copy(update={"physics": (rubs,)})), fmu, TWO_MASSES)
    assert [finding.physics for finding in found.findings] == ["coulomb_friction"]
    assert found.findings[0].parameters["torque_nm"].value == pytest.approx(4.0, rel=0.05)


def test_an_inverse_fmu_is_asked_for_its_torque(tmp_path: Path) -> None:
    plant = foreign.Plant()
    fmu = foreign.inverse(tmp_path, plant)
    rubs = PhysicsTerm.model_validate({"name": "coulomb_friction", "torque_nm": 4.0})
    machine = machine_of(plant, rigid=True).model_copy(update={"physics": (rubs,)})
    _, found = against(recorded(machine), fmu, INVERSE)
    assert [finding.physics for finding in found.findings] == ["coulomb_friction"]
    assert found.findings[0].parameters["torque_nm"].value == pytest.approx(4.0, rel=0.05)


@pytest.fixture(scope="module")
def short() -> Session:
    """A session that is quickly played."""
    session = recorded(machine_of(foreign.Plant()))
    return replace(session, runs=session.runs[:1])


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU of our own."""
    return write_fmu(machine_of(foreign.Plant()), tmp_path_factory.mktemp("ours") / "model.fmu").path


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (("motor_angle", "motor_angel"), 'no variable "motor_angel". Did you mean "motor_angle"'),
        (('variable = "torque"', 'variable = "load_speed"\nunit = "N.m"'), "where the torque is its output"),
        (('variable = "torque"', 'variable = "motor_inertia_kgm2"'), "neither input nor output"),
        (("[start]", "[begin]"), "begin: is not known"),
        (('variable = "motor_speed"', 'variable = "motor_speed"\nunit = "deg"'), "no unit of speed"),
        (('variable = "motor_angle"', 'variable = "motor_angle"\nsign = -1'), "moves"),
        (('variable = "motor_angle"', 'variable = "motor_speed"'), "says nothing of a position"),
        (('[torque]\nvariable = "torque"', ""), "torque: is missing"),
        (("[torque]", "[torque"), "is not TOML"),
        (("[start]", '[solver]\ninterface = "model-exchange"\n[start]'), "which the FMU has not"),
        (("[start]", "[parameters]\nmotor_inertia = 1.0\n[start]"), 'Did you mean "motor_inertia_kgm2"'),
    ],
)
def test_a_wrong_map_is_told(
    changed: tuple[str, str], said: str, short: Session, ours: Path, tmp_path: Path
) -> None:
    assert changed[0] in OURS
    place = tmp_path / "map.toml"
    place.write_text(OURS.replace(*changed), encoding="utf-8")
    with pytest.raises(InputError, match=r".") as raised:
        fmu_belief(short, ours, place)
    assert said in str(raised.value)


def test_an_fmu_that_crashes_or_gives_no_numbers_is_one_sentence(short: Session, tmp_path: Path) -> None:
    for how, said in (
        (foreign.CRASH, "crashed while it was played (SIGSEGV)"),
        (foreign.NO_NUMBER, "no numbers"),
    ):
        with pytest.raises(InputError, match=r".") as raised:
            against(short, foreign.broken(tmp_path, how), BROKEN)
        assert said in str(raised.value)


def test_what_is_no_fmu_or_none_for_this_computer_is_told(
    short: Session, ours: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fmpy  # noqa: PLC0415

    (tmp_path / "text.fmu").write_text("no zip", encoding="utf-8")
    for fmu, said in ((tmp_path / "text.fmu", "not a zip"), (tmp_path / "none.fmu", "is not there")):
        with pytest.raises(InputError, match=said):
            against(short, fmu, OURS)
    monkeypatch.setattr(fmpy, "platform", "win64")
    with pytest.raises(InputError, match=r"this computer is win64\. It has its C sources"):
        against(short, ours, OURS)


def test_the_command_explains_against_an_fmu(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn(tmp_path, 401, among=("coulomb_friction",))
    place = tmp_path / "sessions" / "0000"
    fmu = write_fmu(load_machine(place / "machine.toml"), tmp_path / "model.fmu").path
    (tmp_path / "map.toml").write_text(OURS, encoding="utf-8")
    arguments = ["explain", str(place / "session.h5"), "--belief", str(fmu)]
    for more, code in (
        ((), 2),
        (("--map", str(tmp_path / "map.toml"), "--out", str(tmp_path / "out"), "--json"), 0),
    ):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, *more])
        assert int(ended.value.code or 0) == code
        told = capsys.readouterr()
    document = json.loads(told.out)
    assert [finding["physics"] for finding in document["findings"]] == ["coulomb_friction"]
    assert load_machine(tmp_path / "out" / "machine.toml").physics[-1].name == "coulomb_friction"
