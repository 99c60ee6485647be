"""Sessions of random machines that conceal physics: named, located, measured and proven; or not named at all."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealed_sessions import drawn

from schwung.drivetrain import load_machine, simulate, write_machine
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.explain.explain import explain
from schwung.explain.values import Explanation
from schwung.session import Session

#: Concealed effect, the key that is compared, its tolerance, and the seed of the machine.
EFFECTS = (
    ("coulomb_friction", "torque_nm", 0.05, 401),
    ("viscous_friction", "coefficient_nms", 0.05, 402),
    ("torque_constant", "gain", 0.01, 403),
    ("load_inertia", "scale", 0.02, 404),
    ("cogging", "amplitude_nm", 0.1, 405),
    ("friction_drift", "change_nm", 0.15, 406),
    ("coupling_stiffness", "stiffness_nm_rad", 0.03, 407),
    ("periodic_disturbance", "frequency_hz", 0.01, 408),
    ("torque_lag", "time_constant_s", 0.02, 60042),
)
#: A little off, what is concealed here would draw a name beside its own: a shifted table.
MIMICKED = (("single", ("encoder_eccentricity",), 60018),)


@pytest.mark.parametrize(("name", "key", "tolerance", "seed"), EFFECTS)
def test_a_concealed_effect_is_named_measured_and_proven(
    name: str, key: str, tolerance: float, seed: int, tmp_path: Path
) -> None:
    each = (
        2 if name == "torque_lag" else 1
    )  # its runs are short: one of each leaves too little to prove it by
    session, machine, label = drawn(tmp_path, seed, each, among=(name,))
    found = explain(session, machine)
    assert found.findings, found.notes
    first = found.findings[0]
    assert name == first.physics or name in first.indistinguishable_from
    assert found.verdict == "explained"
    assert found.fit.after.torque_rmse_nm < 1.4 * found.noise_floor.torque_nm
    assert found.fit.after.torque_rmse_nm < found.fit.before.torque_rmse_nm
    assert not set(found.fit.train_runs) & set(found.fit.heldout_runs)
    if name == first.physics and key in label["effects"][0]["parameters"]:
        value, true = first.parameters[key].value, label["effects"][0]["parameters"][key]
        assert isinstance(value, float)
        assert value == pytest.approx(true, rel=tolerance)


@pytest.mark.parametrize(("kind", "among", "seed"), MIMICKED)
def test_no_further_name_is_drawn(kind: str, among: tuple[str, ...], seed: int, tmp_path: Path) -> None:
    session, machine, label = drawn(tmp_path, seed, kind=kind, among=among)
    hidden = {effect["physics"] for effect in label["effects"]}
    assert {finding.physics for finding in explain(session, machine).findings} == hidden


@pytest.mark.parametrize("seed", [420, 2002, 2010, 2020, 2030])  # the others ring long, at 8 kHz
def test_nothing_is_named_where_nothing_is_concealed(seed: int, tmp_path: Path) -> None:
    session, machine, _ = drawn(tmp_path, seed, kind="none")
    found = explain(session, machine)
    assert found.verdict == "consistent"
    assert not found.findings
    assert not found.mismatch
    assert found.fit.before.torque_rmse_nm < 1.35 * found.noise_floor.torque_nm


def test_gains_of_the_controller_are_of_no_account(tmp_path: Path) -> None:
    """The name may not hang on [control], which nobody documents."""
    named = []
    for control in ("none", "wrong"):  # all other sessions here have the right ones
        session, machine, _ = drawn(tmp_path / control, 421, among=("viscous_friction",), control=control)
        named.append([f.physics for f in explain(session, machine).findings])
    assert named[0] == named[1] == ["viscous_friction"]


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, Machine, Explanation]:
    """A session that conceals Coulomb friction, explained."""
    session, machine, _ = drawn(tmp_path_factory.mktemp("rubbing"), 422, 2, among=("coulomb_friction",))
    return session, machine, explain(session, machine)


def test_the_learned_machine_is_written_read_and_simulated(
    rubbing: tuple[Session, Machine, Explanation], tmp_path: Path
) -> None:
    session, machine, found = rubbing
    write_machine(found.machine, tmp_path / "machine.toml")
    learned = load_machine(tmp_path / "machine.toml")
    assert [term.name for term in learned.physics] == ["coulomb_friction"]
    motion = session.runs[0].motion
    assert motion is not None
    time = motion.time(1000.0)
    rubs, plain = (simulate(each, motion.demand(time), time) for each in (learned, machine))
    moving = np.abs(plain.speed_rad_s) > 0.5 * plain.peak_speed_rad_s
    more = np.abs(rubs.torque_nm - plain.torque_nm)[moving]
    assert np.median(more) == pytest.approx(learned.physics[0].number("torque_nm"), rel=0.3)


def test_the_document_is_the_contract_s(rubbing: tuple[Session, Machine, Explanation]) -> None:
    document = json.loads(json.dumps(rubbing[2].to_json()))
    assert document["format"] == "schwung-explanation"
    assert document["version"] == 2
    finding = document["names"][0]
    assert finding["parameters"]["torque_nm"]["unit"] == "N·m"
    low, high = finding["parameters"]["torque_nm"]["ci95"]
    assert low < finding["parameters"]["torque_nm"]["value"] < high
    assert document["mismatch"][0]["coordinate"] == finding["where"]["coordinate"] == "direction"


def test_a_reversed_torque_is_named_with_its_remedy_before_anything_else(
    rubbing: tuple[Session, Machine, Explanation],
) -> None:
    session, machine, _ = rubbing
    runs = tuple(
        replace(run, torque_nm=-run.torque_nm, torque_added_nm=None, extra=dict(run.extra))
        for run in session.runs
    )
    with pytest.raises(InputError, match="torque"):
        explain(replace(session, runs=runs), machine)


def test_one_run_alone_says_what_it_cannot_prove(rubbing: tuple[Session, Machine, Explanation]) -> None:
    session, machine, _ = rubbing
    found = explain(replace(session, runs=session.runs[:1]), machine)
    assert not found.fit.heldout_runs
    assert any("kept aside" in note for note in found.notes)
