"""`[[physics]]` in the machine file: every name and key of the contract, and every defect in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from schwung.drivetrain.effects import PHYSICS, Effects, effects_of
from schwung.drivetrain.machine import Machine, load_machine, paper_machine, write_machine
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.residual import load_torque_table
from schwung.drivetrain.simulation import simulate
from schwung.errors import InputError
from schwung.motion import Motion

MOTOR = {"inertia": 0.012, "viscous_friction": 0.2, "peak_torque": 233.0}
COUPLING = {"stiffness": 24963.0, "damping": 8.62}

#: The file contract's table, copied from it: names, and the keys that each has.
CONTRACT = {
    "coulomb_friction": "torque_nm",
    "stribeck_friction": "coulomb_torque_nm breakaway_torque_nm stribeck_speed_rad_s",
    "asymmetric_friction": "torque_positive_nm torque_negative_nm",
    "viscous_friction": "coefficient_nms",
    "quadratic_drag": "coefficient_nms2",
    "local_friction": "torque_nm centre_rad width_rad",
    "friction_drift": "change_nm",
    "load_torque": "amplitude_nm phase_rad",
    "torque_offset": "torque_nm",
    "load_event": "time_s duration_s peak_nm",
    "periodic_disturbance": "frequency_hz amplitude_nm",
    "cogging": "order amplitude_nm phase_rad",
    "torque_constant": "gain",
    "torque_lag": "time_constant_s",
    "torque_saturation": "limit_nm",
    "measurement_delay": "delay_s",
    "encoder_eccentricity": "amplitude_rad",
    "encoder_harmonic": "order amplitude_rad phase_rad",
    "backlash": "gap_rad",
    "coupling_stiffness": "stiffness_nm_rad",
    "coupling_damping": "damping_nms",
    "nonlinear_stiffness": "cubic_nm_rad3",
    "kinematic_error": "order amplitude_rad phase_rad",
    "extra_compliance": "inertia_kgm2 stiffness_nm_rad damping_nms",
    "load_inertia": "delta_kgm2 scale",
    "inertia_profile_shift": "shift_rad",
}


def _file(directory: Path, *terms: dict[str, Any], coupling: bool = True) -> Path:
    path = directory / "machine.toml"
    tables = {"coupling": COUPLING} if coupling else {}
    path.write_text(
        tomli_w.dumps({"name": "a machine", "motor": MOTOR, **tables, "physics": list(terms)}), "utf-8"
    )
    return path


def _full(name: str) -> dict[str, Any]:
    return {"name": name, **dict.fromkeys(CONTRACT[name].split(), 0.25)}


def test_all_names_of_the_contract() -> None:
    assert [name for name in PHYSICS if name in CONTRACT] == list(CONTRACT)


@pytest.mark.parametrize("name", CONTRACT)
def test_the_contracts_keys_are_enough_and_survive_writing(tmp_path: Path, name: str) -> None:
    machine = load_machine(_file(tmp_path, {**_full(name), "note": "kept", "std_nm": [1, 2]}))
    assert effects_of(machine.physics) != Effects()
    write_machine(machine, tmp_path / "again.toml")
    again = load_machine(tmp_path / "again.toml")
    assert again.physics[0].parameters == {
        **dict.fromkeys(CONTRACT[name].split(), 0.25),
        "note": "kept",
        "std_nm": [1, 2],
    }


@pytest.mark.parametrize(
    ("name", "key"),
    [(n, k) for n, keys in CONTRACT.items() for k in keys.split() if n != "load_inertia"],
)
@pytest.mark.parametrize("value", [None, "0.25", float("nan"), float("inf"), True, [0.25]])
def test_every_key_has_to_be_a_finite_number(tmp_path: Path, name: str, key: str, value: Any) -> None:
    term = _full(name) | {key: value}
    if value is None:
        del term[key]
    with pytest.raises(InputError, match=rf"physics\.{name}: {key} is .*finite number") as caught:
        load_machine(_file(tmp_path, term))
    assert str(tmp_path) in caught.value.place


@pytest.mark.parametrize(
    ("term", "sentence"),
    [
        ({**_full("backlash"), "gap_rad": -1e-3}, r"gap_rad is -0.001\. It has to be 0 or more and at most"),
        ({**_full("backlash"), "gap_rad": 20.0}, r"gap_rad is 20\. .* rad"),
        ({**_full("measurement_delay"), "delay_s": 500.0}, "at most 1 s"),
        ({**_full("measurement_delay"), "delay_s": -1e-4}, "0 or more"),
        ({**_full("torque_lag"), "time_constant_s": -1e-4}, "0 or more and at most 1 s"),
        ({**_full("encoder_eccentricity"), "amplitude_rad": 3.0}, "-0.5 or more and at most 0.5 rad"),
        ({**_full("encoder_harmonic"), "order": 0.0}, "order is 0"),
        ({**_full("encoder_harmonic"), "amplitude_rad": -0.6}, "-0.5 or more and at most 0.5 rad"),
        (
            {**_full("encoder_harmonic"), "order": 2.1},
            "order times amplitude_rad is 0.525: .* -0.5 or more and at most",
        ),
        ({**_full("kinematic_error"), "order": -2.1}, "order is -2.1"),
        (
            {**_full("kinematic_error"), "order": 2.1},
            "order times amplitude_rad is 0.525: .* -0.5 or more and at most",
        ),
        (
            {**_full("kinematic_error"), "order": 1.0, "amplitude_rad": 0.1, "second_amplitude_rad": 0.3},
            "twice order times second_amplitude_rad, is 0.7",
        ),
        ({**_full("torque_constant"), "gain": 0.0}, "more than 0"),
        ({**_full("torque_saturation"), "limit_nm": -5.0}, "positive"),
        ({**_full("coupling_stiffness"), "stiffness_nm_rad": 0}, "positive"),
        ({**_full("coupling_damping"), "damping_nms": -1}, "zero or more"),
        ({**_full("stribeck_friction"), "stribeck_speed_rad_s": 0}, "positive"),
        ({**_full("load_inertia"), "scale": -1}, "scale is -1"),
        (
            {
                "name": "torque_constant_fade",
                "share_at_peak": 4.0,
                "peak_nm": 9.0,
                "time_constant_s": 0.2,
                "start_heat": 0.3,
            },
            "leaves nothing of the torque at first: .* is 1.2",
        ),
        ({"name": "load_torque", "table": [[0.0, 1.0]]}, "pairs of numbers"),
        ({"name": "load_torque", "table": [[0.0, 1.0], [1.0]]}, "pairs of numbers"),
        ({"name": "load_torque", "table": [[0.0, 1.0], [1.0, "2"]]}, "pairs of numbers"),
        ({"name": "load_torque", "table": [[0.0, 1.0], [1.0, float("nan")]]}, "pairs of numbers"),
        ({"name": "load_torque", "table": 3}, "pairs of numbers"),
        ({"name": "load_torque", "table": [[1.0, 1.0], [1.0, 2.0]]}, "do not increase"),
        ({**_full("load_torque"), "table": [[0.0, 1.0], [1.0, 2.0]]}, "amplitude_nm beside table"),
        (
            {"name": "dahl_friction", "torque_nm": 1.0},
            "not a known physics term. There are coulomb_friction, .*",
        ),
    ],
)
def test_impossible_values(tmp_path: Path, term: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        load_machine(_file(tmp_path, term))
    assert f"physics.{term['name']}" in caught.value.place
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "name", ["backlash", "coupling_stiffness", "coupling_damping", "nonlinear_stiffness"]
)
def test_a_rigid_machine_has_no_coupling_to_learn_about(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=rf"physics\.{name}: needs a coupling"):
        load_machine(_file(tmp_path, _full(name), coupling=False))
    rigid = paper_machine().model_copy(
        update={"coupling": None, "physics": (PhysicsTerm.model_validate(_full(name)),)}
    )
    motion = Motion(distance_rad=1.0, duration_s=0.1)
    time = motion.time(1000.0)
    with pytest.raises(InputError, match="needs a coupling"):
        simulate(rigid, motion.demand(time), time)


@pytest.mark.parametrize("name", sorted(CONTRACT.keys() - {"coulomb_friction", "asymmetric_friction", "quadratic_drag",
                                                            "viscous_friction", "torque_offset"}))  # fmt: skip
def test_what_does_not_add_may_be_given_once(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="given twice"):
        load_machine(_file(tmp_path, _full(name), _full(name)))


def test_frictions_and_offsets_add() -> None:
    names = ("coulomb_friction", "asymmetric_friction", "stribeck_friction", "torque_offset", "torque_offset")
    found = effects_of([PhysicsTerm.model_validate(_full(name)) for name in names])
    assert found.coulomb_positive_nm == found.coulomb_negative_nm == 0.75
    assert found.stribeck_rise_nm == 0.0  # breakaway equals Coulomb here
    assert found.offset_nm == 0.5


def test_friction_of_the_motor_and_of_the_load_are_each_their_own() -> None:
    terms = [{"coefficient_nms2": 0.1}, {"load_coefficient_nms2": 0.2}, {"load_coefficient_nms2": 0.3}]
    found = effects_of([PhysicsTerm.model_validate({"name": "quadratic_drag", **term}) for term in terms])
    assert (found.drag_nms2, found.load_drag_nms2) == (0.1, 0.5)


def test_two_tables() -> None:
    term = PhysicsTerm.model_validate({"name": "load_torque", "table": [[0, 1], [1, 2]]})
    table = load_torque_table([term])
    assert table is not None
    np.testing.assert_array_equal(table.at(np.array([0.0, 1.0])), [1.0, 2.0])
    with pytest.raises(InputError, match="two tables"):
        load_torque_table([term, term])


def test_optional_keys_are_neutral_where_absent() -> None:
    scale = PhysicsTerm.model_validate({"name": "load_inertia", "scale": 1.5})
    delta = PhysicsTerm.model_validate({"name": "load_inertia", "delta_kgm2": 0.01})
    assert effects_of([scale]) == Effects(inertia_scale=1.5)
    assert effects_of([delta]) == Effects(inertia_delta_kgm2=0.01)


class TestSimulating:
    MOTION = Motion(distance_rad=1.0, duration_s=0.1)
    TIME = MOTION.time(8000.0)

    def _simulate(self, machine: Machine, *terms: dict[str, Any], **options: Any) -> None:
        learned = tuple(PhysicsTerm.model_validate(term) for term in terms)
        simulate(
            machine.model_copy(update={"physics": learned}),
            self.MOTION.demand(self.TIME),
            self.TIME,
            **options,
        )

    def test_an_inertia_that_is_none(self) -> None:
        with pytest.raises(InputError, match=r"physics\.load_inertia: makes the load's inertia -0\.045"):
            self._simulate(paper_machine(), {"name": "load_inertia", "delta_kgm2": -0.1})

    @pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
    def test_share_of_the_session(self, share: float) -> None:
        with pytest.raises(InputError, match="session_share"):
            self._simulate(paper_machine(), session_share=share)

    def test_what_is_too_fast(self) -> None:
        tiny = {"name": "extra_compliance", "inertia_kgm2": 1e-9, "stiffness_nm_rad": 1e9, "damping_nms": 0}
        with pytest.raises(InputError, match="too fast to simulate"):
            self._simulate(paper_machine(), tiny)


@pytest.mark.parametrize(
    ("name", "given", "meant"),
    [
        ("local_friction", "sharpnes", "sharpness"),
        ("kinematic_error", "second_amplitude", "second_amplitude_rad"),
    ],
)
def test_a_misspelled_key_is_told(tmp_path: Path, name: str, given: str, meant: str) -> None:
    """It would have been left out, and another machine simulated than the one that was written down."""
    with pytest.raises(
        InputError, match=rf"physics\.{name}.* has {given}, which is no key of it.* Is it {meant}\?"
    ):
        load_machine(_file(tmp_path, {**_full(name), given: 2.0}))
