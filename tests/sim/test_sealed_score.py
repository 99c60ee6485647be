"""The sealed benchmark's score: a perfect explanation gets everything, a wrong one nothing."""

import importlib
import json
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from schwung_sim.sealed import FOREIGN_NAMES, LABELS, NAMES

COVERED = {
    "position": [0.0, 3.0], "speed": [-20.0, 20.0], "torque": [-50.0, 50.0], "acceleration": [-900.0, 900.0],
    "direction": [-1.0, 1.0], "time_in_motion": [0.0, 0.5], "run": [0.0, 11.0], "frequency": [0.0, 200.0],
}  # fmt: skip


@pytest.fixture(scope="module")
def benchmark() -> Iterator[dict[str, ModuleType]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
        yield {
            name: importlib.import_module(name) for name in ("explain_truth", "explain_score", "explain_page")
        }


def label(effects: dict[str, dict[str, Any]], kind: str = "single", case: str = "0000") -> dict[str, Any]:
    return {
        "case": case,
        "kind": kind,
        "strength": 10.0,
        "floor_nm": 0.1,
        "effects": [{"physics": name, "parameters": values} for name, values in effects.items()],
        "covered": COVERED,
        "machine": {"mean_inertia_kgm2": 0.1},
    }


def explanation(
    effects: dict[str, dict[str, float]],
    place: tuple[str, list[float]] | None = None,
    verdict: str = "explained",
    twins: tuple[str, ...] = (),
) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "noise": {"torque_nm": 0.12},
        "mismatch": [{"coordinate": place[0], "interval": place[1]}] if place else [],
        "names": [
            {
                "physics": name,
                "probability": 0.97,
                "parameters": {
                    key: {"value": value, "ci95": [0.9 * value, 1.1 * value]} for key, value in values.items()
                },
                "indistinguishable_from": list(twins),
            }
            for name, values in effects.items()
        ],
        "proof": {"after": 1.05},
    }


def scored(benchmark: dict[str, ModuleType], out: Path, of: dict[str, Any], said: dict[str, Any]) -> Any:
    folder = out / "explanations" / of["case"]
    folder.mkdir(parents=True)
    (folder / "explanation.json").write_text(json.dumps(said), encoding="utf-8")
    (folder / "run.json").write_text('{"seconds": 2.0}', encoding="utf-8")
    return benchmark["explain_score"].score_case(of, folder)


def test_every_effect_has_coordinates(benchmark: dict[str, ModuleType]) -> None:
    assert set(benchmark["explain_truth"].COORDINATES) == set(NAMES)
    assert not set(NAMES) & set(FOREIGN_NAMES)


def test_a_perfect_explanation_gets_everything(benchmark: dict[str, ModuleType], tmp_path: Path) -> None:
    values = {"torque_nm": 2.0, "centre_rad": 1.5, "width_rad": 0.4}
    said = explanation({"local_friction": values}, ("position", [1.3, 1.7]))
    score = scored(benchmark, tmp_path, label({"local_friction": values}), said)
    assert score.first_right
    assert score.extra == 0
    assert score.coordinate_right
    assert score.interval_overlap == pytest.approx(1.0)
    assert [(error, held) for _, _, error, held in score.parameters] == [(0.0, True)] * 3
    assert score.after_over_floor == pytest.approx(1.05)
    assert score.floor_ratio == pytest.approx(1.2)


def test_a_wrong_name_place_and_number_are_wrong(benchmark: dict[str, ModuleType], tmp_path: Path) -> None:
    truth = label({"coulomb_friction": {"torque_nm": 2.0}})
    said = explanation({"viscous_friction": {"coefficient_nms": 2.0}}, ("speed", [-20.0, 20.0]))
    score = scored(benchmark, tmp_path, truth, said)
    assert not score.first_right
    assert not score.first_twin
    assert score.extra == 1
    assert score.coordinate_right is False
    assert score.parameters == []
    twin = explanation({"viscous_friction": {"coefficient_nms": 2.0}}, twins=("coulomb_friction",))
    assert scored(benchmark, tmp_path / "twin", truth, twin).first_twin
    off = scored(benchmark, tmp_path / "off", truth, explanation({"coulomb_friction": {"torque_nm": 2.5}}))
    assert off.parameters == [("coulomb_friction", "torque_nm", 0.25, False)]


def test_what_is_less_probable_than_half_is_no_name(benchmark: dict[str, ModuleType], tmp_path: Path) -> None:
    said = explanation({"coulomb_friction": {"torque_nm": 2.0}, "viscous_friction": {"coefficient_nms": 0.1}})
    said["names"][1]["probability"] = 0.3
    score = scored(benchmark, tmp_path, label({"coulomb_friction": {"torque_nm": 2.0}}), said)
    assert score.names == ["coulomb_friction"]


def test_angles_turn_and_inertias_compare_by_their_change(benchmark: dict[str, ModuleType]) -> None:
    errors = benchmark["explain_truth"].parameter_errors
    truth = label({"cogging": {"order": 12.0, "amplitude_nm": 1.0, "phase_rad": 3.1}})
    found = explanation({"cogging": {"order": 12.0, "amplitude_nm": 1.0, "phase_rad": -3.1}})["names"][0]
    by_key = {key: error for key, error, _ in errors(truth["effects"][0], found["parameters"], truth)}
    assert by_key["phase_rad"] == pytest.approx(2 * 3.141592653589793 - 6.2)
    truth = label({"load_inertia": {"scale": 1.2, "delta_kgm2": 0.0}})
    found = explanation({"load_inertia": {"scale": 1.0, "delta_kgm2": 0.02}})["names"][0]
    assert errors(truth["effects"][0], found["parameters"], truth)[0][1] == pytest.approx(0.0, abs=1e-9)
    truth = label({"load_torque": {"amplitude_nm": 2.0, "phase_rad": 0.5}})
    found = explanation({"load_torque": {"amplitude_nm": -2.0, "phase_rad": 0.5 - 3.141592653589793}})
    assert errors(truth["effects"][0], found["names"][0]["parameters"], truth)[0][1] < 1e-9


def test_a_load_torque_is_a_curve_through_its_points(benchmark: dict[str, ModuleType]) -> None:
    """As the plant has it: with other points of the same curve nothing is off."""
    points = np.array([[0.0, 1.0], [1.0, 3.0], [2.0, -1.0], [3.0, 0.0]])
    angles = np.linspace(0.0, 3.0, 61)
    finer = np.stack([angles, PchipInterpolator(*points.T)(angles)], axis=1).tolist()
    truth = label({"load_torque": {"table": points.tolist()}})
    found = {"table": {"value": finer, "ci95": None}}
    ((key, error, held),) = benchmark["explain_truth"].parameter_errors(truth["effects"][0], found, truth)
    assert (key, held) == ("curve", None)
    assert error < 1e-3


def test_the_summary_counts_every_kind(benchmark: dict[str, ModuleType], tmp_path: Path) -> None:
    friction, offset = {"coulomb_friction": {"torque_nm": 2.0}}, {"torque_offset": {"torque_nm": 1.0}}
    cases = [
        (label(friction, case="0000"), explanation(friction, ("direction", [-1.0, 1.0]))),
        (label(friction | offset, "two", "0001"), explanation(friction, ("direction", [-1.0, 1.0]))),
        (label(friction | offset, "two", "0002"), explanation(offset | friction, ("run", [0.0, 11.0]))),
        (label({}, "none", "0003"), explanation({}, verdict="consistent")),
        (label({}, "none", "0004"), explanation(offset)),
        (label({"thermal_fade": {"loss": 0.1}}, "foreign", "0005"), explanation({}, verdict="unexplained")),
        (label({"thermal_fade": {"loss": 0.1}}, "foreign", "0006"), explanation(offset)),
    ]
    (tmp_path / LABELS).parent.mkdir()
    (tmp_path / LABELS).write_text("".join(json.dumps(of) + "\n" for of, _ in cases), encoding="utf-8")
    for of, said in cases:
        scored(benchmark, tmp_path, of, said)
    scores = benchmark["explain_score"].score_all(tmp_path)
    lines = {key.strip(): value for key, value in benchmark["explain_score"].summary(scores).items()}
    assert lines["right name first"].endswith("(1/1)")
    assert lines["two or three: all named"].endswith("(1/2)")
    assert lines["nothing hidden: false alarms"].endswith("(1/2)")
    assert lines["foreign: not named as something else"].endswith("(1/2)")
    assert lines["claimed explained"].endswith("(1/2)")
    assert lines["true coordinate first"].endswith("(3/3)")
    text = benchmark["explain_score"].printed(scores)
    assert "coulomb_friction" in text
    benchmark["explain_score"].write_scores(tmp_path, scores)
    assert (tmp_path / "score_confusion.csv").read_text(encoding="utf-8").startswith("hidden")


def test_the_page_tells_demands_and_misses(benchmark: dict[str, ModuleType], tmp_path: Path) -> None:
    friction, offset = {"coulomb_friction": {"torque_nm": 2.0}}, {"torque_offset": {"torque_nm": 1.0}}
    folder = tmp_path / "single"
    cases = [(label(friction, case="0000"), explanation(friction, ("direction", [-1.0, 1.0])))]
    cases += [(label(offset, case="0001"), explanation(friction, ("direction", [-1.0, 1.0])))]
    (folder / LABELS).parent.mkdir(parents=True)
    lines = [json.dumps({**of, "seed": 70 + n}) + "\n" for n, (of, _) in enumerate(cases)]
    (folder / LABELS).write_text("".join(lines), encoding="utf-8")
    for of, said in cases:
        scored(benchmark, folder, of, said)
    page = benchmark["explain_page"].page(tmp_path)
    assert "| one effect, clear: right name first | ≥ 97 % | 50 % (1/2) |" in page
    assert "| one effect, weak: right name first | ≥ 90 % | not run |" in page
    assert "| 70 to 71 |" in page
    assert "| 71 | torque_offset | coulomb_friction | explained |" in page


def test_a_run_that_failed_is_counted_as_failed(benchmark: dict[str, ModuleType], tmp_path: Path) -> None:
    (tmp_path / "error.txt").write_text("Traceback\nValueError: no", encoding="utf-8")
    score = benchmark["explain_score"].score_case(label({"coulomb_friction": {"torque_nm": 1.0}}), tmp_path)
    assert score.first == benchmark["explain_score"].FAILED
    assert score.error == "ValueError: no"
    foreign = benchmark["explain_score"].score_case(
        label({"thermal_fade": {"loss": 0.1}}, "foreign"), tmp_path
    )
    summary = benchmark["explain_score"].summary([foreign])
    assert summary["foreign: not named as something else"].endswith("(0/1)")  # to crash is not to abstain
