"""An FMU as the belief: what it leaves out of a recording is named as with a machine file; strangers' FMUs, too.

Recordings are the virtual machine room's, or simulated and given noise; the FMUs are our own exports, or small ones in
C that `foreign_fmus.py` writes in other units and signs.
"""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from schwung.cli import main
from schwung.drivetrain import InertiaTable, Machine, load_machine, simulate, write_machine
from schwung.drivetrain.machine import Control, Coupling, Load, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.errors import InputError
from schwung.explain.publishing.publish import publish
from schwung.explain.publishing.values import Published
from schwung.motion import Array, Excitation, Motion
from schwung.session import Run, Session, SessionWriter, read_session
from schwung.simulators.belief import fmu_belief
from schwung.simulators.fmu import write_fmu
from schwung.simulators.followed import Followed, along, recording_of
from schwung.simulators.needed import MotorMotion, needed, two_masses
from schwung.simulators.spectrum import Spectrum
from schwung_sim.sealed import CaseWishes, draw_case, read_labels, write_case

fmpy = pytest.importorskip("fmpy")
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


def against(session: Session, fmu: Path, mapped: str) -> tuple[Machine, Published]:
    """The stand-in, and what the FMU leaves out."""
    place = fmu.with_name("map.toml")
    place.write_text(mapped, encoding="utf-8")
    belief = fmu_belief(session, fmu, place)
    return belief.machine, publish(session, belief.machine, twin=belief.twin)


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
    """A stroke to and fro without and with injection, at 1 kHz, with noise."""
    chance = np.random.default_rng(5)
    motion = Motion(
        kind="poly5", distance_rad=3.0, duration_s=0.25, start_time_s=0.05, returns=True, dwell_s=0.05
    )
    ticks = np.arange(8 * 670) / 8000
    sine = Excitation(frequency_hz=50, amplitude_nm=25.0)
    runs = []
    for role, excitation in (("reference", None), ("excited", sine)):
        moved = simulate(
            machine, motion.demand(ticks), ticks, None if excitation is None else sine.torque(ticks)
        )
        noise = chance.standard_normal((3, ticks.size))
        runs.append(
            Run(
                role=role,  # type: ignore[arg-type]
                repeat=0,
                sample_rate_hz=1000.0,
                time_s=ticks[::8],
                position_rad=(moved.position_rad + 2e-6 * noise[0])[::8],
                speed_rad_s=(moved.speed_rad_s + 0.02 * noise[1])[::8],
                torque_nm=(moved.torque_nm + 0.1 * noise[2])[::8],
                motion=motion,
                excitation=excitation,
            )
        )
    return Session(runs=tuple(runs), created="2026-01-01T00:00:00Z", source="test")


def one_run(session: Session) -> Session:
    """The one with injection: an FMU is asked for each run as it is and shaken, and tells its masses by that."""
    return replace(session, runs=session.runs[1:])


def missed(session: Session, machine: Machine, twin: Session | None = None) -> Array:
    """What a belief misses of the moving axis within the band, one run after the other (N·m); what it misses of a
    twin, too, is taken off."""
    recording = recording_of(session, 0.1)
    masses = two_masses(machine)

    def left(run: Followed) -> Array:
        motion = MotorMotion(
            run.position_rad, run.speed_rad_s, run.acceleration_rad_s2, 1 / recording.rate_hz
        )
        spectrum = Spectrum(run.time_s.size, recording.rate_hz, 4 / recording.band_hz)
        return spectrum.apply(run.torque_nm - needed(masses, motion), spectrum.low_pass(recording.band_hz))

    every = []
    for number, run in enumerate(recording.runs):
        beyond = left(run) if twin is None else left(run) - left(along(twin, recording).runs[number])
        every.append(beyond[np.abs(run.speed_rad_s) > 0.1 * np.max(np.abs(run.speed_rad_s))])
    return np.concatenate(every)


@pytest.mark.long
@pytest.mark.timeout(300)  # it compiles most of what weighing needs, where nobody has yet
def test_a_payload_is_named_against_an_fmu_as_with_a_machine_file(tmp_path: Path) -> None:
    """Friction is, with the commands of the page for users."""
    session, believed, label = drawn(tmp_path, 404, among=("load_inertia",))
    session = replace(session, runs=session.runs[::2][:4])  # two motions, both roles
    assert len({(run.role, run.motion and run.motion.duration_s) for run in session.runs}) == len(
        session.runs
    )
    fmu = write_fmu(believed, tmp_path / "model.fmu", fmi=3).path
    stand_in, found = against(session, fmu, OURS)
    assert stand_in.coupling is not None
    assert believed.coupling is not None
    assert stand_in.coupling.stiffness_nm_rad == pytest.approx(believed.coupling.stiffness_nm_rad, rel=0.02)
    (hidden,) = label["effects"]
    (named,) = (one for one in found.names if one.in_file)
    assert found.verdict == "explained"
    assert named.physics == hidden["physics"] == "load_inertia"
    assert named.parameters["scale"].value == pytest.approx(hidden["parameters"]["scale"], rel=0.005)


@pytest.mark.long
def test_the_commands_of_the_page_for_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """docs/simulators.md from end to end, with its map: the learned FMU misses nothing of the session it came from."""
    page = (Path(__file__).parents[2] / "docs" / "simulators.md").read_text("utf-8")
    commands = re.findall(r"^    schwung (.*)$", page, re.M)
    (mapped,) = re.findall(r"^```toml\n(.*?)^```", page, re.M | re.S)
    monkeypatch.chdir(tmp_path)
    session, believed, _ = drawn(tmp_path / "drawn", 401, among=("coulomb_friction",))
    with SessionWriter("session.h5", source="test") as writer:
        for run in session.runs[::3][:4]:  # of two motions one without and one with injection
            writer.append(run)
    write_machine(believed, "machine.toml")
    Path("map.toml").write_text(mapped, encoding="utf-8")
    for command in commands:
        with pytest.raises(SystemExit) as ended:
            main([*command.split(), "--json"])
        told = capsys.readouterr()
        assert not ended.value.code, told.err
    assert {"machine.fmu", "machine3.fmu", "Machine.mo", "machine.m"} <= {
        one.name for one in tmp_path.iterdir()
    }
    learned, document = (
        json.loads(Path("explanation/explanation.json").read_text("utf-8")),
        json.loads(told.out),
    )
    assert [one["physics"] for one in learned["names"] if one["in_file"]] == ["coulomb_friction"]
    assert document["verdict"] == "consistent"
    assert document["proof"]["before"] < 1.2 * learned["proof"]["after"]  # in deviations of the noise
    assert any("stand-in" in note for note in document["notes"])
    assert load_machine("against/machine.toml").coupling is not None


@pytest.mark.parametrize("more", [(), ("-m", "machine.toml")])
def test_one_belief_is_wanted_and_a_map_with_an_fmu(
    more: tuple[str, ...], ours: Path, capsys: pytest.CaptureFixture[str], short: Session, tmp_path: Path
) -> None:
    with SessionWriter(tmp_path / "session.h5", source="test") as writer:
        writer.append(short.runs[0])
    with pytest.raises(SystemExit) as ended:
        main(["explain", str(tmp_path / "session.h5"), "--belief", str(ours), *more])
    assert ended.value.code == 2
    assert ("one belief" if more else "without a map") in capsys.readouterr().err


#: What the FMUs' recordings conceal: so the twin has to stay by the recording although the torque would drive it away.
RUBS = PhysicsTerm.model_validate({"name": "coulomb_friction", "torque_nm": 4.0})


@pytest.mark.long
def test_a_stranger_s_model_exchange_in_degrees_and_rpm_the_other_way_round(tmp_path: Path) -> None:
    plant = foreign.Plant()
    fmu, machine = foreign.two_masses(tmp_path, plant), machine_of(plant)
    session = one_run(recorded(machine.model_copy(update={"physics": (RUBS,)})))
    (tmp_path / "map.toml").write_text(TWO_MASSES, encoding="utf-8")
    belief = fmu_belief(session, fmu, tmp_path / "map.toml")
    assert belief.machine.coupling is not None
    assert belief.machine.coupling.stiffness_nm_rad == pytest.approx(plant.k, rel=0.02)
    assert belief.machine.motor.inertia_kgm2 == pytest.approx(plant.rotor, rel=0.02)
    told, ours = missed(session, belief.machine, belief.twin), missed(session, machine)
    assert np.std(ours) > 3
    assert np.std(told - ours) < 0.02


@pytest.mark.long
def test_an_inverse_fmu_is_asked_for_its_torque(tmp_path: Path) -> None:
    plant = foreign.Plant()
    fmu, machine = foreign.inverse(tmp_path, plant), machine_of(plant, rigid=True)
    session = one_run(recorded(machine.model_copy(update={"physics": (RUBS,)})))
    (tmp_path / "map.toml").write_text(INVERSE, encoding="utf-8")
    belief = fmu_belief(session, fmu, tmp_path / "map.toml")
    told, ours = missed(session, belief.machine, belief.twin), missed(session, machine)
    assert np.std(ours) > 3
    assert np.std(told - ours) < 0.02
    assert any("input brake should be" in note for note in belief.notes)


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
        (foreign.FAILS, "failed while it was played: fmi2DoStep failed"),
    ):
        with pytest.raises(InputError, match=r".") as raised:
            against(short, foreign.broken(tmp_path, how), BROKEN)
        assert said in str(raised.value)


def test_what_is_no_fmu_or_none_for_this_computer_is_told(
    short: Session, ours: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "text.fmu").write_text("no zip", encoding="utf-8")
    with zipfile.ZipFile(tmp_path / "photos.fmu", "w") as archive:
        archive.writestr("holiday.txt", "no model")
    told = (("text", "not a zip"), ("none", "is not there"), ("photos", "no FMU that can be read"))
    for name, said in told:
        fmu = tmp_path / f"{name}.fmu"
        with pytest.raises(InputError, match=said):
            against(short, fmu, OURS)
    monkeypatch.setattr(fmpy, "platform", "win64")
    with pytest.raises(InputError, match=r"this computer is win64\. It has its C sources"):
        against(short, ours, OURS)
