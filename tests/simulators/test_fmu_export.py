"""FMUs of learned machines, played by FMPy: the same motion as our own simulation, for FMI 2 and FMI 3."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import exported_machines as machines
import numpy as np
import pytest

from schwung.cli import main
from schwung.drivetrain import write_machine
from schwung.drivetrain.effects import PHYSICS, Effects
from schwung.errors import InputError
from schwung.simulators.fmu import FmiVersion, WrittenFmu, write_fmu

CASES = machines.cases()
#: The round trip's tolerance is the issue's; what is measured is near 1e-13.
CLOSE = 1e-6
#: Steps per tick where ours and the FMU would choose differently (by the peak torque, by the torque at hand).
STEPS = {"rigid, curves": 2}
Written = Callable[[str, FmiVersion], WrittenFmu]
needs_compiler = pytest.mark.skipif(
    not any(shutil.which(name) for name in ("cc", "gcc", "clang")), reason="no C compiler"
)


def played(path: Path, torque_nm: np.ndarray, start: dict[str, float]) -> Any:
    """The FMU under a torque that is held from sample to sample."""
    fmpy = pytest.importorskip("fmpy")
    given = np.array(
        list(zip(machines.TIME, torque_nm, strict=True)), dtype=[("time", float), ("torque", float)]
    )
    return fmpy.simulate_fmu(
        str(path), start_time=0.0, stop_time=machines.TIME[-1], output_interval=1 / machines.RATE_HZ,
        input=given, start_values=start, output=["motor_angle", "motor_speed", "load_angle", "load_speed"],
    )  # fmt: skip


def test_every_term_is_played() -> None:
    named = {term.name for case in CASES.values() for term in case.machine.physics}
    assert named == set(PHYSICS) - {"torque_filter"}  # which is of the report alone


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """The FMU of a case, compiled once where several tests look at it."""
    folder = tmp_path_factory.mktemp("fmus")

    @cache
    def of(name: str, fmi: FmiVersion) -> WrittenFmu:
        path = folder / f"{list(CASES).index(name)}-{fmi}.fmu"
        return write_fmu(CASES[name].machine, path, fmi=fmi, start_rad=machines.START_RAD)

    return of


@needs_compiler
@pytest.mark.parametrize(
    ("name", "fmi"),
    # the physics is one source for both; what differs is how it is called, and whether there is a load state
    [*((name, 3) for name in CASES), ("plain", 2), ("shaft", 2), ("rigid, curves", 2)],
)
def test_the_motion_is_that_of_our_own_simulation(name: str, fmi: FmiVersion, written: Written) -> None:
    case = CASES[name]
    ours = machines.simulated(case, STEPS.get(name))
    start = {"session_share": case.share, "motion_start_s": machines.leaves_rest_s()}
    made = written(name, fmi)
    assert made.platform
    told = played(made.path, ours.torque_nm, start)
    assert machines.apart(told["motor_angle"], ours.position_rad) < CLOSE
    assert machines.apart(told["motor_speed"], ours.speed_rad_s) < CLOSE
    assert machines.apart(told["load_angle"], ours.load_position_rad) < CLOSE
    assert machines.apart(told["load_speed"], ours.load_speed_rad_s) < CLOSE


@needs_compiler
def test_a_parameter_can_be_changed(written: Written) -> None:
    """The plain machine's FMU with the payload set is the FMU of the machine with the payload."""
    plain = CASES["plain"].machine
    heavier = CASES["friction"].machine.physics[-2]
    ours = machines.simulated(machines.Case(plain.model_copy(update={"physics": (heavier,)})))
    payload = {"inertia_delta_kgm2": heavier.number("delta_kgm2"), "inertia_scale": heavier.number("scale")}
    with_it, without = (played(written("plain", 2).path, ours.torque_nm, start) for start in (payload, {}))
    assert machines.apart(with_it["motor_speed"], ours.speed_rad_s) < CLOSE
    assert machines.apart(without["motor_speed"], ours.speed_rad_s) > 1e-2


@needs_compiler
@pytest.mark.parametrize("fmi", [2, 3])
def test_the_description_is_valid_and_names_units(fmi: FmiVersion, written: Written) -> None:
    fmpy = pytest.importorskip("fmpy")
    path = written("shaft", fmi).path
    described = fmpy.read_model_description(str(path), validate=True)
    units = {one.name: one.unit for one in described.modelVariables}
    assert units["torque"] == "N.m"
    assert units["motor_angle"] == "rad"
    assert units["coupling_stiffness_nm_rad"] == "N.m/rad"
    parameters = {one.name for one in described.modelVariables if one.causality == "parameter"}
    assert set(Effects._fields) <= parameters
    assert all(one.description for one in described.modelVariables)
    with zipfile.ZipFile(path) as archive:
        assert {"sources/machine.c", "sources/machine_data.h", f"sources/fmi{fmi}.c"} <= set(
            archive.namelist()
        )


@needs_compiler
def test_an_impossible_parameter_is_refused_by_the_fmu(written: Written) -> None:
    pytest.importorskip("fmpy")
    with pytest.raises(Exception, match="fmi2EnterInitializationMode"):
        played(written("plain", 2).path, np.zeros_like(machines.TIME), {"inertia_delta_kgm2": -1.0})


@needs_compiler
def test_states_can_be_kept_and_taken_up_again(written: Written, tmp_path: Path) -> None:
    """What an optimiser does: a state kept, a step made, and made again from there."""
    fmpy = pytest.importorskip("fmpy")
    folder = fmpy.extract(str(written("shaft", 3).path), unzipdir=str(tmp_path / "unpacked"))
    described = fmpy.read_model_description(folder)
    fmu = fmpy.instantiate_fmu(folder, described, fmi_type="CoSimulation")
    at = {one.name: one.valueReference for one in described.modelVariables}
    fmu.enterInitializationMode(startTime=0.0)
    fmu.exitInitializationMode()
    fmu.setFloat64([at["torque"]], [5.0])
    kept = fmu.serializeFMUState(fmu.getFMUState())
    speeds = []
    for _ in range(2):
        fmu.setFMUState(fmu.deserializeFMUState(kept))
        fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.01)
        speeds += fmu.getFloat64([at["motor_speed"]])
    fmu.terminate()
    fmu.freeInstance()
    assert speeds[0] == speeds[1] != 0.0


def test_without_a_compiler_the_sources_are_there_and_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    written = write_fmu(CASES["plain"].machine, tmp_path / "machine.fmu")
    assert written.platform is None
    assert "no C compiler" in written.note
    with zipfile.ZipFile(written.path) as archive:
        assert not [name for name in archive.namelist() if name.startswith("binaries/")]


def test_the_same_machine_is_the_same_file(written: Written, tmp_path: Path) -> None:
    again = write_fmu(CASES["plain"].machine, tmp_path / "b.fmu", start_rad=machines.START_RAD).path
    assert again.read_bytes() == written("plain", 2).path.read_bytes()


def test_an_unknown_inertia_is_told(tmp_path: Path) -> None:
    plain = CASES["plain"].machine
    unknown = plain.model_copy(update={"load": plain.load.model_copy(update={"inertia_table": None})})
    with pytest.raises(InputError, match=r"load\.inertia is not known"):
        write_fmu(unknown, tmp_path / "machine.fmu")
    assert not list(tmp_path.iterdir())


def _export(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["export", *arguments])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_the_command_writes_all_three(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_machine(CASES["friction"].machine, tmp_path / "machine.toml")
    code, out, _ = _export(
        capsys, "-m", str(tmp_path / "machine.toml"), "--fmu", str(tmp_path / "machine.fmu"), "--fmi", "3",
        "--modelica", str(tmp_path / "Machine.mo"), "--matlab", str(tmp_path / "machine.m"), "--json",
    )  # fmt: skip
    told = json.loads(out)
    assert code == 0
    assert told["fmu"]["fmi"] == 3
    assert told["modelica"]["model"] == "Machine"
    assert {"machine.fmu", "Machine.mo", "machine.m"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "no inertia table"),
        (("--fmu", "machine.fmu"), "--machine: is missing"),
        (("-m", "machine.toml", "--fmu", "machine.fmu", "--fmi", "1"), "--fmi: is 1"),
        (("-m", "machine.toml", "--matlab", "my machine.m"), "my_machine.m"),
        (("-m", "machine.toml", "--modelica", "machine.txt"), "machine.mo"),
        (("-m", "machine.toml", "--fmu", "nowhere/machine.fmu"), "cannot be written"),
    ],
)
def test_what_is_missing_is_told_in_one_sentence(
    arguments: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    write_machine(CASES["plain"].machine, tmp_path / "machine.toml")
    before = sorted(path.name for path in tmp_path.iterdir())
    code, _, err = _export(capsys, *arguments)
    assert code == 2
    assert said in err
    assert sorted(path.name for path in tmp_path.iterdir()) == before
