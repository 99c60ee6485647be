"""The machine file: what is written is read again, and every defect is one sentence that names its place."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from schwung.drivetrain.inertia import InertiaTable, LoadTorqueTable, slider_crank_inertia
from schwung.drivetrain.machine import (
    Control,
    Coupling,
    Load,
    Machine,
    Motor,
    load_machine,
    paper_machine,
    write_machine,
)
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.errors import InputError

MOTOR = {"inertia": 0.012, "viscous_friction": 0.2, "peak_torque": 233.0}
COUPLING = {"stiffness": 24963.0, "damping": 8.62}
CONTROL = {"position_gain": 60, "speed_gain": 7, "speed_integral_time": 0.008, "sample_rate": 8000}


def _file(directory: Path, **tables: Any) -> Path:
    path = directory / "machine.toml"
    path.write_text(tomli_w.dumps({"name": "a machine", "motor": MOTOR, **tables}), encoding="utf-8")
    return path


def _plain(machine: Machine) -> dict[str, Any]:
    """A machine as plain values, tables as lists: comparable."""
    plain = machine.model_dump(exclude={"load": {"inertia_table", "torque_table"}})
    if (inertia := machine.load.inertia_table) is not None:
        std = None if inertia.std_kgm2 is None else inertia.std_kgm2.tolist()
        plain["inertia"] = (inertia.position_rad.tolist(), inertia.inertia_kgm2.tolist(), std)
    if (torque := machine.load.torque_table) is not None:
        plain["torque"] = (torque.position_rad.tolist(), torque.load_torque_nm.tolist())
    return plain


class TestReading:
    def test_every_table_and_unit(self, tmp_path: Path) -> None:
        (tmp_path / "sub").mkdir()
        (tmp_path / "sub" / "j.csv").write_text("position_rad,inertia_kgm2\n0,0.05\n1,0.07\n")
        load = {"viscous_friction": 0.1, "inertia_table": "sub/j.csv", "torque": -3}
        machine = load_machine(_file(tmp_path, coupling=COUPLING, load=load, control=CONTROL))
        assert machine.motor == Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0)
        assert machine.coupling == Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62)
        assert machine.required_control() == Control(
            position_gain_per_s=60, speed_gain_nms=7, speed_integral_time_s=0.008, sample_rate_hz=8000
        )
        np.testing.assert_allclose(
            machine.load_inertia_at(np.array([-1.0, 0.0, 1.0, 2.0])), [0.05, 0.05, 0.07, 0.07]
        )
        np.testing.assert_array_equal(machine.load_torque_at(np.array([0.0, 9.0])), [-3.0, -3.0])

    def test_the_least_machine_is_rigid_and_of_unknown_load(self, tmp_path: Path) -> None:
        machine = load_machine(_file(tmp_path))
        assert machine.coupling is None
        assert machine.load_inertia is None
        with pytest.raises(InputError, match=r"load\.inertia is not known"):
            machine.load_inertia_at(np.zeros(1))
        with pytest.raises(InputError, match=r"has no \[control\]"):
            machine.required_control()

    def test_load_torque_table(self, tmp_path: Path) -> None:
        (tmp_path / "t.csv").write_text("position_rad,load_torque_nm\n0,-1\n1,3\n")
        load = {"viscous_friction": 0, "inertia": 0.1, "torque_table": "t.csv"}
        machine = load_machine(_file(tmp_path, load=load))
        np.testing.assert_allclose(machine.load_torque_at(np.array([0.0, 0.5, 1.0, 5.0])), [-1, 1, 3, 3])
        assert machine.load_inertia == 0.1

    def test_unknown_keys_and_learned_terms_are_kept(self, tmp_path: Path) -> None:
        path = _file(
            tmp_path,
            motor={**MOTOR, "maker": "who"},
            service={"due": 2030},
            physics=[
                {"name": "coulomb_friction", "torque_nm": 1.5, "learned_on": "Monday"},
                {"name": "load_torque", "table": [[0.0, 1.0], [2, -3.5]]},
            ],
        )
        machine = load_machine(path)
        assert machine.physics[0].number("torque_nm") == 1.5
        write_machine(machine, tmp_path / "again.toml")
        again = load_machine(tmp_path / "again.toml")
        assert again == machine
        assert again.model_extra == {"service": {"due": 2030}}
        assert again.motor.model_extra == {"maker": "who"}
        assert again.physics[0].parameters == {"torque_nm": 1.5, "learned_on": "Monday"}
        assert again.physics[1].parameters == {"table": [[0.0, 1.0], [2, -3.5]]}

    def test_only_the_keys_of_the_file_format_count(self, tmp_path: Path) -> None:
        motor = {"inertia_kgm2": 0.012, "viscous_friction": 0.2, "peak_torque": 233.0}
        with pytest.raises(InputError, match=r"motor\.inertia: is missing"):
            load_machine(_file(tmp_path, motor=motor))


class TestDefects:
    @pytest.mark.parametrize(
        ("tables", "place", "remedy"),
        [
            ({"motor": {}}, "motor.inertia", "kg·m²"),
            ({"motor": {**MOTOR, "inertia": 0.0}}, "motor.inertia", "greater than 0"),
            ({"motor": {**MOTOR, "inertia": -0.012}}, "motor.inertia", "greater than 0"),
            ({"motor": {**MOTOR, "inertia": "0.012"}}, "motor.inertia", "number"),
            ({"motor": {**MOTOR, "inertia": True}}, "motor.inertia", "number"),
            ({"motor": {**MOTOR, "inertia": float("nan")}}, "motor.inertia", "finite"),
            ({"motor": {**MOTOR, "inertia": 120_000.0}}, "motor.inertia", "less than"),  # g·cm²
            ({"motor": {**MOTOR, "inertia": 120.0}}, "motor.inertia", "kg·cm²"),  # kg·cm²
            ({"motor": {**MOTOR, "viscous_friction": -0.1}}, "motor.viscous_friction", "N·m·s/rad"),
            ({"motor": {**MOTOR, "peak_torque": float("inf")}}, "motor.peak_torque", "finite"),
            ({"motor": {**MOTOR, "rated_torque": 300}}, "motor.rated_torque", "correct"),
            ({"motor": 0.012}, "motor", "[motor]"),
            ({"coupling": {**COUPLING, "stiffness": 0}}, "coupling.stiffness", "N·m/rad"),
            ({"coupling": {"stiffness": 1e4}}, "coupling.damping", "Add it in N·m·s/rad"),
            ({"coupling": []}, "coupling", "[coupling]"),
            ({"load": {"inertia": 0.1}}, "load.viscous_friction", "N·m·s/rad"),
            ({"load": {"viscous_friction": 0, "inertia": 550.0}}, "load.inertia", "kg·cm²"),
            ({"load": {"viscous_friction": 0, "inertia_table": 3}}, "load.inertia_table", "CSV"),
            ({"load": {"viscous_friction": 0, "inertia_table": "no.csv"}}, "no.csv", "CSV"),
            ({"load": {"viscous_friction": 0, "inertia_table": "\0"}}, "\\x00", "CSV"),
            ({"load": {"viscous_friction": 0, "torque": float("nan")}}, "load.torque", "finite"),
            ({"load": "heavy"}, "load", "[load]"),
            ({"control": {**CONTROL, "speed_integral_time": 8}}, "control.speed_integral_time", "in s"),  # ms
            ({"control": {**CONTROL, "sample_rate": 8}}, "control.sample_rate", "in Hz"),  # kHz
            ({"control": {"position_gain": 60}}, "control.speed_gain", "Add it"),
            ({"physics": [{"torque_nm": 1.0}]}, "physics.0.name", "Add it"),
            ({"physics": {"name": "x"}}, "physics", "It must be"),
            ({"name": 3}, "name", "string"),
        ],
    )
    def test_place_and_remedy(self, tmp_path: Path, tables: dict[str, Any], place: str, remedy: str) -> None:
        path = _file(tmp_path, **tables)
        with pytest.raises(InputError) as caught:
            load_machine(path)
        assert str(tmp_path) in caught.value.place
        assert caught.value.place.endswith(place) or place in caught.value.place
        assert remedy in caught.value.remedy
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize(
        ("tables", "meant"),
        [
            ({"couplin": COUPLING}, "coupling"),
            ({"laod": {"viscous_friction": 0, "inertia": 0.1}}, "load"),
            ({"load": {"viscous_friction": 0, "inertia_kgm2": 0.1}}, "inertia"),
            ({"motor": {**MOTOR, "rated_torqe": 100.0}}, "rated_torque"),
            ({"Control": CONTROL}, "control"),
            ({"efort": "current"}, "effort"),
        ],
    )
    def test_a_misspelled_key_that_may_be_left_out(
        self, tmp_path: Path, tables: dict[str, Any], meant: str
    ) -> None:
        """It would be left out without a word: a machine without its coupling is another one."""
        with pytest.raises(InputError, match=rf"is no key of a machine file\. Is it {meant}\?"):
            load_machine(_file(tmp_path, **tables))

    def test_what_is_like_a_key_that_is_there_is_kept(self, tmp_path: Path) -> None:
        path = _file(tmp_path, coupling=COUPLING, couplings="elastomer, size 19")
        assert load_machine(path).model_extra == {"couplings": "elastomer, size 19"}

    def test_number_and_table_at_once(self, tmp_path: Path) -> None:
        (tmp_path / "j.csv").write_text("position_rad,inertia_kgm2\n0,0.05\n1,0.07\n")
        load = {"viscous_friction": 0.1, "inertia_table": "j.csv", "inertia": 0.1}
        with pytest.raises(InputError, match=r"load\.inertia: is given beside inertia_table\. Keep one"):
            load_machine(_file(tmp_path, load=load))

    @pytest.mark.parametrize(
        ("content", "problem"),
        [
            (b"name = ", "is not TOML"),
            (b"\xff\xfe", "is not UTF-8"),
            (b"x = " + b"9" * 5000, "is not TOML"),  # longer than Python turns into an int
            (b"x = " + b"[" * 5000, "is not TOML"),
            (b"", "is missing"),
        ],
    )
    def test_what_is_no_machine_file(self, tmp_path: Path, content: bytes, problem: str) -> None:
        path = tmp_path / "machine.toml"
        path.write_bytes(content)
        with pytest.raises(InputError, match=problem):
            load_machine(path)

    def test_an_inertia_table_in_place_of_the_machine(self, tmp_path: Path) -> None:
        (tmp_path / "inertia.csv").write_text("position_rad,inertia_kgm2\n0,0.05\n1,0.07\n")
        with pytest.raises(InputError, match=r"inertia\.csv: is not TOML.*Give a machine\.toml"):
            load_machine(tmp_path / "inertia.csv")

    def test_missing_and_directory(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="no such file"):
            load_machine(tmp_path / "none.toml")
        load = {"viscous_friction": 0.1, "inertia_table": "measured.csv"}
        with pytest.raises(
            InputError, match=r"measured\.csv: .* \(load\.inertia_table in machine\.toml names it\)"
        ):
            load_machine(_file(tmp_path, load=load))
        with pytest.raises(InputError, match="is a directory"):
            load_machine(tmp_path)

    def test_a_term_without_its_number(self) -> None:
        for value in (None, "1", float("inf"), True):
            term = PhysicsTerm.model_validate({"name": "torque_offset", "torque_nm": value})
            with pytest.raises(InputError, match=r"physics\.torque_offset: torque_nm is"):
                term.number("torque_nm")

    @given(
        where=st.sampled_from([("name",), ("motor",), ("motor", "inertia"), ("load",), ("load", "inertia"),
                               ("coupling", "damping"), ("control", "sample_rate"), ("physics",)]),
        value=st.recursive(
            st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
            lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
            max_leaves=5,
        ),
    )  # fmt: skip
    def test_anything_in_any_place_is_read_or_refused(self, where: tuple[str, ...], value: Any) -> None:
        data: dict[str, Any] = {
            "name": "x",
            "motor": dict(MOTOR),
            "coupling": dict(COUPLING),
            "load": {"viscous_friction": 0.1, "inertia": 0.1},
            "control": dict(CONTROL),
        }
        inner = data
        for key in where[:-1]:
            inner = inner[key]
        inner[where[-1]] = value
        if value is None:  # TOML has no null: the key is absent
            del inner[where[-1]]
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "machine.toml"
            try:
                path.write_text(tomli_w.dumps(data), encoding="utf-8")
            except (TypeError, UnicodeEncodeError):  # a null further in, half a surrogate pair: no TOML
                return
            with contextlib.suppress(InputError):
                assert load_machine(path).motor.inertia_kgm2 > 0


def _numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


@st.composite
def machines(draw: st.DrawFn) -> Machine:
    """Any machine that the file format can hold."""
    rotor = draw(_numbers(1e-6, 0.1))
    load: dict[str, Any] = {"viscous_friction_nms": draw(_numbers(0, 10))}
    angles = np.cumsum(draw(st.lists(_numbers(1e-3, 3.0), min_size=2, max_size=8)))
    n = angles.size
    inertias = np.array(draw(st.lists(_numbers(1e-9, 1e3 * rotor), min_size=n, max_size=n)))
    load |= draw(
        st.sampled_from(
            [
                {},
                {"inertia_kgm2": float(inertias[0])},
                {"inertia_table": InertiaTable(angles, inertias)},
                {"inertia_table": InertiaTable(angles, inertias, inertias / 7)},
            ]
        )
    )
    torques = np.array(draw(st.lists(_numbers(-1e5, 1e5), min_size=n, max_size=n)))
    load |= draw(
        st.sampled_from(
            [{}, {"torque_nm": float(torques[0])}, {"torque_table": LoadTorqueTable(angles, torques)}]
        )
    )
    text = st.text(st.characters(codec="utf-8"), min_size=1)
    return Machine(
        name=draw(text),
        motor=Motor(
            inertia_kgm2=rotor,
            viscous_friction_nms=draw(_numbers(0, 10)),
            peak_torque_nm=rotor * draw(_numbers(20, 1e7)),
        ),
        coupling=draw(
            st.none() | st.builds(Coupling, stiffness=_numbers(1e-3, 1e9), damping=_numbers(0, 1e6))
        ),
        load=Load(**load),
        control=draw(
            st.none()
            | st.builds(
                Control,
                position_gain=_numbers(0.1, 1e4),
                speed_gain=_numbers(1e-6, 1e6),
                speed_integral_time=_numbers(1e-5, 5),
                sample_rate=_numbers(100, 1e6),
            )
        ),
        physics=tuple(
            PhysicsTerm.model_validate({"name": name, "torque_nm": value, "remark": draw(text)})
            for name, value in draw(
                st.dictionaries(
                    st.sampled_from(["coulomb_friction", "torque_offset"]), _numbers(-1e9, 1e9), max_size=2
                )
            ).items()
        ),
    )


class TestWriting:
    @settings(max_examples=60)
    @given(machine=machines())
    def test_round_trip(self, machine: Machine) -> None:
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "m.toml"
            write_machine(machine, path)
            assert _plain(load_machine(path)) == _plain(machine)

    def test_rewriting_the_file_it_came_from(self, tmp_path: Path) -> None:
        write_machine(paper_machine(), tmp_path / "a.toml")
        write_machine(load_machine(tmp_path / "a.toml"), tmp_path / "a.toml")
        assert _plain(load_machine(tmp_path / "a.toml")) == _plain(paper_machine())
        assert sorted(p.name for p in tmp_path.iterdir()) == ["a.toml", "a_inertia.csv"]  # nothing temporary

    def test_two_machines_in_one_directory_keep_their_tables(self, tmp_path: Path) -> None:
        light = paper_machine()
        table = InertiaTable(np.array([0.0, 1.0]), np.array([0.2, 0.3]))
        heavy = light.model_copy(update={"load": Load(inertia_table=table)})
        write_machine(light, tmp_path / "light.toml")
        write_machine(heavy, tmp_path / "heavy.toml")
        assert _plain(load_machine(tmp_path / "light.toml")) == _plain(light)

    def test_nowhere_to_write(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="cannot be written: no such file or directory"):
            write_machine(paper_machine(), tmp_path / "none" / "machine.toml")


def test_paper_machine_is_table_1() -> None:
    machine = paper_machine()
    assert machine.motor.peak_torque_nm == 233
    assert machine.motor.inertia_kgm2 == 0.012
    assert machine.motor.viscous_friction_nms == 0.2
    assert machine.coupling == Coupling(stiffness_nm_rad=24963, damping_nms=8.62)
    assert machine.load.viscous_friction_nms == 0.1
    angle = np.linspace(0, np.pi, 1001)
    np.testing.assert_allclose(machine.load_inertia_at(angle), slider_crank_inertia(angle), rtol=1e-4)
