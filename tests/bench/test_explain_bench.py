"""Physics concealed in the bench's machine, recorded over CAN as by `schwung commission`, and found by `explain`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from bench_machine import desk, guessed_machine

from schwung.drivetrain import Control, InertiaTable, Machine
from schwung.explain.publishing.publish import publish
from schwung.explain.publishing.values import Published
from schwung.explain.values import Quantity
from schwung.session import Session
from schwung_sim.plants import Plant, make_plant
from schwung_sim.plants.crank_kernel import MOTOR
from schwung_sim.plants.slider_crank import SliderCrankMachine, SliderCrankPlant


def _with(table: InertiaTable) -> Machine:
    machine = guessed_machine()
    load = machine.load.model_copy(update={"inertia_kgm2": None, "inertia_table": table})
    control = Control(  # the drive's, as commissioning reads them
        position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=0.02, sample_rate_hz=8000.0
    )
    return machine.model_copy(update={"load": load, "control": control})


@cache
def _by_geometry(plant: str) -> Machine:
    """The machine with the inertia that follows from its masses and lengths."""
    angles = np.linspace(-0.3, np.pi + 0.3, 371)
    return _with(InertiaTable(angles, make_plant(plant).true_inertia(angles)))


def _recorded(out: Path, plant: str | Plant = "two-mass", conceal: str = "", **wishes: object) -> Session:
    # Time passes with SYNC alone: a crank without a brake falls while the plan is made.
    with desk(plant, conceal=conceal, seed=11, clock="sync") as room:
        return room.record(out, repeats=2, **wishes)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Recorded of two masses that conceal nothing."""
    return _recorded(tmp_path_factory.mktemp("sound"))


def _named(found: Published) -> dict[str, Mapping[str, Quantity]]:
    """What the published machine has by its name."""
    return {one.physics: one.parameters for one in found.names if one.in_file}


@pytest.mark.long
def test_nothing_is_named_where_nothing_is_concealed(sound: Session) -> None:
    """Through counts and filters of the drive, and an injection that is held between SYNCs."""
    found = publish(sound, _by_geometry("two-mass"))
    assert found.verdict == "consistent"
    assert not found.in_file
    assert found.proof is not None
    assert found.proof.before < 1.2


@pytest.mark.long
def test_in_mujoco_two_masses_miss_no_more_than_how_it_integrates(tmp_path: Path) -> None:
    """Its semi-implicit steps make the coupling appear 0.1 % stiffer and 2 % more damped: nothing else, if that."""
    found = publish(_recorded(tmp_path, "slider-crank"), _by_geometry("slider-crank"))
    assert found.verdict in ("consistent", "explained")
    assert found.proof is not None
    assert found.proof.before < 1.3
    nearly = {"coupling_damping": ("damping_nms", 8.62), "coupling_stiffness": ("stiffness_nm_rad", 24963.0)}
    for name, parameters in _named(found).items():
        key, truth = nearly[name]
        assert parameters[key].value == pytest.approx(truth, rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize(
    ("conceal", "physics", "key", "truth", "tolerance"),
    [
        ("coulomb_friction=3", "coulomb_friction", "torque_nm", 3.0, 0.02),
        ("cogging", "cogging", "amplitude_nm", 2.33, 0.02),
        ("measurement_delay=0.0005", "measurement_delay", "delay_s", 0.0005, 0.03),
        ("torque_constant=0.93", "torque_constant", "gain", 0.93, 0.003),
    ],
)
def test_what_the_bench_conceals_is_named_and_measured(
    conceal: str, physics: str, key: str, truth: float, tolerance: float, tmp_path: Path
) -> None:
    found = publish(_recorded(tmp_path, conceal=conceal), _by_geometry("two-mass"))
    assert found.verdict == "explained"
    assert list(_named(found)) == [physics]
    assert _named(found)[physics][key].value == pytest.approx(truth, rel=tolerance)
    (term,) = found.machine.physics
    assert term.parameters[key] == pytest.approx(_named(found)[physics][key].value)  # what is told is proven
    assert found.proof is not None
    assert found.proof.runs == (3,)
    assert found.proof.taken > 0.99


@pytest.mark.long
def test_a_machine_that_changed_since_its_inertia_was_measured(sound: Session, tmp_path: Path) -> None:
    """The belief scatters as an estimate does: ±0.0007 kg·m² at 64 angles, the slope of which would be 6 N·m."""
    angles, chance = np.linspace(0.0, np.pi, 64), np.random.default_rng(7)
    inertia = make_plant("two-mass").true_inertia(angles) + 0.0007 * chance.standard_normal(64)
    measured = _with(InertiaTable(angles, inertia, np.full(64, 0.0007)))
    assert not _named(publish(sound, measured))
    found = publish(_recorded(tmp_path / "now", conceal="load_inertia"), measured)
    assert found.verdict in ("explained", "partly_explained")  # what the table is off by is left
    assert list(_named(found)) == ["load_inertia"]
    value = {key: quantity.value for key, quantity in _named(found)["load_inertia"].items()}
    mean = float(np.mean(make_plant("two-mass").true_inertia(np.linspace(0.0, np.pi, 99))))
    added = value.get("delta_kgm2", 0.0) + mean * (value.get("scale", 1.0) - 1)
    assert added == pytest.approx(0.15 * mean, rel=0.1)


@pytest.mark.long
def test_the_joint_friction_that_mujoco_computes_itself(tmp_path: Path) -> None:
    """Hard, as dry friction is: by default MuJoCo's rises with speed."""
    plant = SliderCrankPlant()
    plant.model.dof_frictionloss[MOTOR] = 3.0
    plant.model.dof_solref[MOTOR] = (2 * plant.model.opt.timestep, 1.0)
    plant.model.dof_solimp[MOTOR] = (0.9999, 0.9999, 0.001, 0.5, 2.0)
    found = publish(_recorded(tmp_path, plant), _by_geometry("slider-crank"))
    assert found.verdict == "explained"
    assert list(_named(found)) == ["coulomb_friction"]
    assert _named(found)["coulomb_friction"]["torque_nm"].value == pytest.approx(3.0, rel=0.02)


@pytest.mark.long
def test_the_weight_of_a_rod_that_mujoco_knows_and_two_masses_do_not(tmp_path: Path) -> None:
    """Half the crank times the rod's weight, over the cosine of the angle: it lifts the rod's middle."""
    machine = SliderCrankMachine()
    found = publish(
        _recorded(tmp_path, SliderCrankPlant(machine, gravity=True)), _by_geometry("slider-crank")
    )
    named = _named(found)
    assert next(iter(named)) == "load_torque"
    assert set(named) <= {"load_torque", "coupling_damping"}  # which MuJoCo's steps make 2 % larger
    weight = named["load_torque"]
    assert weight["amplitude_nm"].value == pytest.approx(
        machine.rod_kg * 9.80665 * machine.crank_m / 2, rel=0.03
    )
    assert weight["phase_rad"].value == pytest.approx(-np.pi / 2, abs=0.05)


@pytest.mark.long
def test_an_inertia_that_the_belief_only_guessed_is_found(sound: Session) -> None:
    """One name, and no curves that take its part: a table's corners were some N·m in its slope."""
    found = publish(sound, guessed_machine())
    likely = [one.physics for one in found.names if one.probability > 0.5]
    assert likely == ["inertia_profile"]
    assert not [one for one in found.curves if one.probability > 0.5 and one.torque_nm > 0.1]
    assert found.proof is not None
    assert found.proof.before > 20
    assert found.proof.after < 1.5
