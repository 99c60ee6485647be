"""A recording in A, of which nobody knows how many N·m an ampere makes: A all through, and never taken for N·m."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from report_samples import session as in_torque

from schwung.cli import main
from schwung.commissioning.export import ExportChoice, export_values
from schwung.drivetrain import Coupling, Load, Machine, Motor, load_machine, paper_machine, write_machine
from schwung.drivetrain.inertia import read_inertia_csv, write_inertia_csv
from schwung.errors import InputError
from schwung.estimation import estimate
from schwung.explain.publishing.publish import publish
from schwung.fieldbus.profile import load_profile
from schwung.quantities import Effort, document_of, sentences_of
from schwung.session import Session, read_session
from schwung.session.imports import import_recordings, make_recipe, write_session
from schwung.session.interchange import read_any, write_any

NM_PER_A = 1.7


def session() -> Session:
    """The recording of the report's tests, its torques in A."""
    runs = tuple(
        replace(
            run,
            torque_nm=run.torque_nm / NM_PER_A,
            excitation=run.excitation
            and run.excitation.model_copy(update={"amplitude_nm": run.excitation.amplitude_nm / NM_PER_A}),
        )
        for run in in_torque().runs
    )
    return replace(in_torque(), runs=runs, effort="current")


def machine(effort: Effort = "current", nm: float = NM_PER_A) -> Machine:
    """A belief in A: whatever has N·m in its unit, by as much."""
    torque = paper_machine()
    assert torque.coupling is not None
    return Machine(
        name="in A",
        motor=Motor(
            inertia_kgm2=torque.motor.inertia_kgm2 / nm,
            viscous_friction_nms=torque.motor.viscous_friction_nms / nm,
            peak_torque_nm=torque.motor.peak_torque_nm / nm,
        ),
        coupling=Coupling(
            stiffness_nm_rad=torque.coupling.stiffness_nm_rad / nm,
            damping_nms=torque.coupling.damping_nms / nm,
        ),
        load=Load(viscous_friction_nms=torque.load.viscous_friction_nms / nm, inertia_kgm2=0.11 / nm),
        effort=effort,
    )


def test_an_estimate_in_amperes_is_that_in_torque_over_the_unknown_constant() -> None:
    known = estimate(in_torque(), machine("torque", 1.0), "denoised").table
    found = estimate(session(), machine(), "denoised").table
    assert found.effort == "current"
    np.testing.assert_allclose(found.inertia_kgm2 * NM_PER_A, known.inertia_kgm2, rtol=1e-6)


def test_a_belief_of_the_other_kind_is_refused() -> None:
    with pytest.raises(InputError, match="the session in A, and how many N·m an ampere makes is unknown"):
        estimate(session(), paper_machine())
    with pytest.raises(InputError, match="is in A, the session in N·m"):
        publish(in_torque(), machine())


def test_the_file_says_so_and_an_older_reader_sees_the_unit(tmp_path: Path) -> None:
    write_session(session(), tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5") as file:
        assert file.attrs["effort"] == "current"
        assert file["run/0000/torque"].attrs["unit"] == "A"  # version 1 readers expect N·m and refuse
    assert read_session(tmp_path / "s.h5").effort == "current"
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        del file.attrs["effort"]
    with pytest.raises(InputError, match='unit is "A", expected "N·m"'):
        read_session(tmp_path / "s.h5")
    write_session(in_torque(), tmp_path / "t.h5")
    with h5py.File(tmp_path / "t.h5") as file:
        assert "effort" not in file.attrs  # as before
    for suffix in ("mf4", "parquet"):
        pytest.importorskip("asammdf" if suffix == "mf4" else "pyarrow")
        write_any(session(), tmp_path / f"s.{suffix}")
        assert read_any(tmp_path / f"s.{suffix}").effort == "current"


def test_tables_say_their_unit_and_are_never_exported(tmp_path: Path) -> None:
    table = estimate(session(), machine(), "denoised").table
    write_inertia_csv(table, tmp_path / "inertia.csv")
    assert (tmp_path / "inertia.csv").read_text().startswith("position_rad,inertia_as2_rad,std_as2_rad\n")
    again = read_inertia_csv(tmp_path / "inertia.csv")
    assert again.effort == "current"
    with pytest.raises(InputError, match=r"A·s²/rad.*unknown"):
        export_values(lambda index, sub: None, load_profile("schwung-bench"), again, ExportChoice())  # type: ignore[arg-type, return-value]


def test_a_machine_in_amperes_stays_one(tmp_path: Path) -> None:
    table = estimate(session(), machine(), "denoised").table
    measured = machine().model_copy(update={"load": Load(viscous_friction_nms=0.05, inertia_table=table)})
    write_machine(measured, tmp_path / "m.toml")
    assert 'effort = "current"' in (tmp_path / "m.toml").read_text()
    assert load_machine(tmp_path / "m.toml").effort == "current"
    text = (tmp_path / "m.toml").read_text().replace('effort = "current"\n', "")
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(InputError, match=r"load\.inertia_table: is in A·s²/rad"):
        load_machine(tmp_path / "m.toml")
    write_machine(paper_machine(), tmp_path / "t.toml")
    assert "effort" not in (tmp_path / "t.toml").read_text()
    with pytest.raises(InputError, match="needs N·m"):
        measured.require_torque("a commissioning")


def test_no_newton_metre_is_left_in_what_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_session(session(), tmp_path / "s.h5")
    write_machine(machine(), tmp_path / "m.toml")
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as ended:
        main(["estimate", str(tmp_path / "s.h5"), "-m", str(tmp_path / "m.toml"), "--out", str(out)])
    assert not ended.value.code
    written = (out / "report.html").read_text() + capsys.readouterr().out
    assert "A·s²/rad" in written
    assert "N·m" not in written
    assert "kg·m²" not in written
    document = json.loads((out / "estimate.json").read_text())
    assert document["effort"] == "current"
    assert "N·m" not in json.dumps(document, ensure_ascii=False)


def recording(path: Path, header: str) -> Path:
    angle = np.sin(np.arange(400) / 40)
    rows = [f"{k / 1000},{q},{2 * q}" for k, q in enumerate(angle)]
    path.write_text(f"t,q,{header}\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "given", "effort", "factor"),
    [
        ("Iq [A]", {}, "current", 1.0),
        ("Iq [mA]", {}, "current", 1e-3),
        ("Iq [A]", {"torque_unit": "A=0.31"}, "torque", 0.31),
        ("Iq [A]", {"torque_scale": "-1"}, "current", -1.0),
        ("Iq [A]", {"torque_scale": "0.31"}, "torque", 0.31),
        ("I", {"torque_unit": "A"}, "current", 1.0),
        ("I", {}, "torque", 1.0),
    ],
)
def test_a_current_stays_one_until_somebody_says_the_constant(
    tmp_path: Path, header: str, given: dict[str, str], effort: str, factor: float
) -> None:
    path = recording(tmp_path / "x.csv", header)
    recipe = make_recipe({"position": "q", "torque": "2", "split": "none", **given})
    found = import_recordings([path], recipe)
    assert found.session.effort == effort
    assert any("a current and stays one" in note for note in found.notes) == (effort == "current")
    np.testing.assert_allclose(found.session.runs[0].torque_nm, factor * 2 * np.sin(np.arange(400) / 40))


def test_files_of_both_kinds_make_no_session(tmp_path: Path) -> None:
    files = [recording(tmp_path / "a.csv", "M [A]"), recording(tmp_path / "b.csv", "M [Nm]")]
    with pytest.raises(InputError, match=r"a\.csv: is in A, .*b\.csv in N·m"):
        import_recordings(files, make_recipe({"position": "q", "torque": "M", "split": "none"}))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("0.4 N·m (rms) and 3 N·m·s/rad", "0.4 A (rms) and 3 A·s/rad"),
        ("2 kg·m² of 3 kg·m²", "2 A·s²/rad of 3 A·s²/rad"),
        ("95 kg, 203 N·s/m, 20 N", "95 A·s²/m, 203 A·s/m, 20 A"),
        ("Nothing in N runs; NaN", "Nothing in N runs; NaN"),
    ],
)
def test_sentences_in_amperes(text: str, told: str) -> None:
    assert sentences_of("current")(text) == told
    assert sentences_of("torque")(text) == text
    assert document_of("torque", {"unit": "N"}) == {"unit": "N"}
    assert document_of("current", {"unit": "N", "torque_nm": [1.0]})["unit"] == "A"
