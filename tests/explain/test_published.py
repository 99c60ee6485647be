"""What weighing publishes: a file that is proven as it is read back, and says nothing twice."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealed_sessions import fewer
from strangers import Stranger, belief_of, session_of

from schwung.drivetrain import load_machine, write_machine
from schwung.drivetrain.effects import PHYSICS, effects_of
from schwung.drivetrain.machine import Machine, paper_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.residual import residuals_of
from schwung.errors import InputError
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.known import known
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.kept_aside import kept_aside
from schwung.explain.publishing.formula import formulas
from schwung.explain.publishing.learned import Found, learned, table
from schwung.explain.publishing.publish import _possible, _Publishing, publish
from schwung.explain.publishing.values import Published
from schwung.explain.weighing.values import Parameter

ROOT = Stranger("friction over the root of speed", (), (0.0, 0.0, 0.22, 0.0))


def small(stranger: Stranger, seed: int = 5) -> Any:
    """Two motion times, one run each without and with injection, every eighth tick logged."""
    return fewer(session_of(stranger, seed, every=8, times=(0.25, 0.4)), 1)


@pytest.fixture(scope="module")
def root() -> Published:
    """Of a machine whose friction has no name."""
    return publish(small(ROOT), belief_of(ROOT))


@pytest.mark.long
def test_what_has_no_name_is_a_curve_in_the_file_with_a_formula(root: Published) -> None:
    assert not [one for one in root.names if one.probability > 0.5]
    (curve,) = [one for one in root.curves if one.probability > 0.5]
    assert (curve.coordinate, curve.in_file) == ("speed", True)
    assert "√|ω|" in curve.formula
    assert curve.drawn is not None
    fast = curve.drawn.x > 3
    wanted = -0.22 * np.sqrt(curve.drawn.x[fast])
    assert curve.drawn.forward_nm[fast] == pytest.approx(wanted, abs=0.03)
    assert curve.drawn.backward_nm[fast] == pytest.approx(-wanted, abs=0.03)
    (term,) = root.machine.physics
    assert (term.name, term.parameters["coordinate"]) == ("residual", "speed")
    assert root.proof is not None
    assert root.proof.before > 3
    assert root.proof.after < 1.1
    assert root.left == pytest.approx(0.0, abs=0.05)


@pytest.mark.long
def test_what_makes_the_runs_kept_aside_less_likely_is_not_told() -> None:
    """Dry friction in all runs but that one: what is fitted there says nothing of the machine."""
    dry = Stranger("dry friction", ("coulomb_friction",), (0.3, 0.0, 0.0, 0.0))
    rubbing, free = small(dry), small(Stranger("nothing", ()))
    aside = kept_aside(rubbing)
    runs = tuple(free.runs[n] if n in aside else run for n, run in enumerate(rubbing.runs))
    found = publish(replace(rubbing, runs=runs), belief_of(dry))
    assert found.verdict == "unexplained"
    assert not [one for one in found.names if one.probability > 0.5]
    assert not found.machine.physics
    assert not any("coulomb_friction" in names for names, _ in found.runners_up)
    assert "coulomb friction makes the runs kept aside less likely" in "".join(found.notes)


def test_a_cause_of_which_nothing_is_told_is_in_no_set() -> None:
    """A transmission that other motions refute stood beside a coupling's curve with more than 99 %."""
    sets = [(0.7, ("kinematic_error", "wind_up")), (0.2, ("backlash",)), (0.1, ("wind_up",))]
    search = SimpleNamespace(
        candidate=lambda pick: SimpleNamespace(name=pick, named=pick != "wind_up"),
        shares=lambda: [(share, SimpleNamespace(picks=names)) for share, names in sets],
    )
    outcome = SimpleNamespace(disproved={"backlash"}, left_out={"kinematic_error", "backlash"})
    publication = SimpleNamespace(
        search=search, outcome=outcome, chosen=SimpleNamespace(set=SimpleNamespace(picks=("wind_up",)))
    )
    assert _Publishing._runners_up(publication) == ((("wind_up",), pytest.approx(0.8)),)  # type: ignore[arg-type]  # a stand-in


@pytest.mark.long
def test_a_fresh_session_of_the_machine_finds_nothing_beyond_the_file(root: Published) -> None:
    again = publish(small(ROOT, 6), root.machine)
    assert not [one for one in (*again.names, *again.curves) if one.probability > 0.5]
    assert len(again.machine.physics) == 1
    assert again.proof is not None
    assert again.proof.before < 1.1


def test_the_document_has_everything(root: Published) -> None:
    document = root.to_json()
    assert (document["format"], document["version"]) == ("schwung-explanation", 2)
    (unnamed,) = [one for one in document["unnamed"] if one["probability"] > 0.5]
    assert len(unnamed["curve"]["x"]) == len(unnamed["curve"]["forward_std_nm"])
    assert document["proof"]["runs"]
    assert document["left"] < 0.05
    assert "without a name" in document["headline"]


def found(law: str, named: bool = True, **parameters: Any) -> Found:
    """As the search gives it; a second law becomes a level curve."""
    level = {"coordinate": "position", "table": [[0.0, 1.0, 1.0], [1.0, 1.0, 1.0]]}
    return Found(law, named, parameters, {"probability": 0.9}, lambda: level)


def believing(*terms: dict[str, Any]) -> Machine:
    """The paper's machine with these."""
    physics = tuple(PhysicsTerm.model_validate(term) for term in terms)
    return paper_machine().model_copy(update={"physics": physics})


@pytest.mark.parametrize(
    ("had", "new", "is_now"),
    [
        ({"name": "coulomb_friction", "torque_nm": 1.0}, {"torque_nm": 0.5}, {"torque_nm": 1.5}),
        ({"name": "quadratic_drag", "coefficient_nms2": 0.3}, {"load_coefficient_nms2": 0.2},
         {"coefficient_nms2": 0.3, "load_coefficient_nms2": 0.2}),
        ({"name": "coupling_stiffness", "stiffness_nm_rad": 9e3}, {"stiffness_nm_rad": 8e3}, {"stiffness_nm_rad": 8e3}),
        ({"name": "torque_constant", "gain": 1.1}, {"gain": 0.95}, {"gain": 1.05}),
        ({"name": "load_inertia", "scale": 1.1, "delta_kgm2": 0.01}, {"scale": 1.2},
         {"scale": 1.32, "delta_kgm2": 0.012}),
        (
            {"name": "load_torque", "amplitude_nm": 3.0, "phase_rad": 0.0},
            {"amplitude_nm": 4.0, "phase_rad": np.pi / 2},
            {"amplitude_nm": 5.0, "phase_rad": np.arctan2(4, 3)},
        ),
        (
            {"name": "encoder_harmonic", "order": 16.0, "amplitude_rad": 3e-4, "phase_rad": np.pi / 2},
            {"order": 16.0, "amplitude_rad": 4e-4, "phase_rad": np.pi},
            {"order": 16.0, "amplitude_rad": 5e-4, "phase_rad": np.arctan2(3, -4)},
        ),
        ({"name": "residual", "like": "viscous_friction", "coefficient_nms": 0.1}, {"coefficient_nms": 0.2},
         {"coefficient_nms": 0.3}),
    ],
)  # fmt: skip
def test_a_law_that_is_known_is_changed_not_listed_twice(
    had: dict[str, Any], new: dict[str, Any], is_now: dict[str, float]
) -> None:
    law = had.get("like", had["name"])
    machine = learned(believing(had), [found(law, **new)])
    (term,) = machine.physics
    assert term.name == law
    assert {key: term.parameters[key] for key in is_now} == pytest.approx(is_now)


def test_a_second_of_a_law_that_cannot_be_one_becomes_a_curve() -> None:
    spot = {"name": "local_friction", "torque_nm": 2.0, "centre_rad": 1.0, "width_rad": 0.3}
    second = found("local_friction", torque_nm=1.0, centre_rad=2.0, width_rad=0.2)
    machine = learned(believing(spot), [second])
    assert [term.name for term in machine.physics] == ["local_friction", "residual"]
    assert machine.physics[1].parameters["law"] == "local_friction"
    assert residuals_of(machine.physics)["position"].highest_nm == 1.0


def test_tables_add_up_and_what_is_not_surely_a_name_is_none(tmp_path: Any) -> None:
    x = np.linspace(0, 1, 5)
    rows = {"coordinate": "speed", "table": table(x, x, -x)}
    machine = learned(believing({"name": "residual", **rows}), [found("residual", **rows), found("cogging", False,
                      order=8.0, amplitude_nm=1.0, phase_rad=0.0)])  # fmt: skip
    write_machine(machine, tmp_path / "machine.toml")
    read = load_machine(tmp_path / "machine.toml").physics
    assert [term.name for term in read] == ["residual", "residual"]
    assert read[1].parameters["like"] == "cogging"
    assert effects_of(read).cogging_amplitude_nm == 1.0
    assert residuals_of(read)["speed"].highest_nm == pytest.approx(2.0)


def test_what_a_file_forbids_is_not_written() -> None:
    machine = learned(believing(), [found("torque_lag", time_constant_s=-1e-6)])
    assert machine.physics[0].number("time_constant_s") == 0.0


def test_every_name_of_the_vocabulary_can_be_in_a_file() -> None:
    of = Ranges(0.0, 3.0, 20.0, 2e3, 100.0, 0.5, 0.04, 4, 160.0)
    names = {one.name for one in vocabulary(of, known(paper_machine(), 0.0, 3.0)) if one.named}
    assert names <= set(PHYSICS)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (lambda x: -0.9 - 0.54 * np.cos(1.3 * x + 0.4), "cos(1.3·θ"),
        (lambda x: 2 * np.sqrt(x), "2·√θ"),
        (lambda x: 1 + 3 * np.exp(-x / 0.5), "3·exp(−θ/0.5)"),
        (lambda x: 0.7 * x**2, "0.7·θ²"),
    ],
)
def test_formulas_are_found_again(law: Any, words: str) -> None:
    x = np.linspace(0, 4, 49)
    each = formulas(x, law(x), np.full(49, 0.01), "θ")
    short = next(one for one in each if one.misfit < 1e-3)
    assert words in short.text
    assert short.terms <= 2
    assert short.at(np.array([1.234])) == pytest.approx(law(np.array([1.234])), abs=1e-3)


def test_a_session_in_amperes_needs_a_machine_in_amperes() -> None:
    session = small(ROOT)
    object.__setattr__(session, "effort", "current")
    with pytest.raises(InputError, match="is in N·m, the session in A"):
        publish(session, belief_of(ROOT))


@pytest.mark.parametrize(
    ("law", "key", "known", "told"),
    [
        (
            "torque_constant_fade",
            "start_heat",
            (0.01, -0.02, 0.04),
            (0.0, 0.04),
        ),  # no motor is colder than cold
        ("stiffness_over_angle", "share", (0.8, 0.7, 0.95), (0.7, 0.9)),
        ("torque_offset", "torque_nm", (0.01, -0.02, 0.04), (-0.02, 0.04)),
    ],
)
def test_no_interval_holds_what_no_machine_has(
    law: str, key: str, known: tuple[float, float, float], told: tuple[float, float]
) -> None:
    assert _possible(Parameter(*known), PHYSICS[law][key]) == told
