"""CAN logs by a DBC: signals in physical units, each on the stamps of its frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from schwung.errors import InputError
from schwung.session.imports import import_recordings, make_recipe, read_table

pytest.importorskip("cantools")

DBC = """\
VERSION ""
NS_ :
BS_:
BU_: Drive
BO_ 385 Motion: 6 Drive
 SG_ Angle : 0|32@1- (0.001,0) [0|0] "deg" Host
 SG_ Torque : 32|16@1- (0.01,0) [0|0] "Nm" Host
BO_ 641 Slow: 2 Drive
 SG_ Temperature : 0|16@1+ (0.1,0) [0|0] "degC" Host
"""


def written(folder: Path, cut: int | None = None) -> tuple[Path, Path]:
    lines = []
    for k in range(900):
        angle, torque = round(90e3 * np.sin(k / 60)), round(-300 * np.sin(k / 60))
        data = (
            (angle.to_bytes(4, "little", signed=True) + torque.to_bytes(2, "little", signed=True))
            .hex()
            .upper()
        )
        lines.append(f"({k / 500:.6f}) can0 181#{data[:4] if k == cut else data}")
        if k % 50 == 0:
            lines.append(f"({k / 500 + 1e-4:.6f}) can0 281#F401")
    (folder / "bus.log").write_text("\n".join(lines) + "\n")
    (folder / "bus.dbc").write_text(DBC)
    return folder / "bus.log", folder / "bus.dbc"


def test_signals_come_in_their_units(tmp_path: Path) -> None:
    log, dbc = written(tmp_path)
    names = [column.name for column in read_table(log, dbc).columns]
    assert names == ["Motion.Angle", "Motion.Torque", "Slow.Temperature"]
    recipe = make_recipe({"position": "Angle", "torque": "Torque", "dbc": str(dbc), "split": "none"})
    run = import_recordings([log], recipe).session.runs[0]
    assert run.sample_rate_hz == 500
    np.testing.assert_allclose(run.position_rad, np.pi / 2 * np.sin(np.arange(900) / 60), atol=1e-5)
    np.testing.assert_allclose(run.torque_nm, -3 * np.sin(np.arange(900) / 60), atol=0.0051)


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    log, dbc = written(tmp_path, cut=7)
    with pytest.raises(InputError, match=r"bus\.log: line 9: is no Motion"):
        read_table(log, dbc)
    with pytest.raises(InputError, match=r"--eds DRIVE\.eds, or --dbc"):
        read_table(log)
    with pytest.raises(InputError, match="no such file"):
        read_table(log, tmp_path / "none.dbc")
    (tmp_path / "bad.dbc").write_text("BO_ nothing of the sort")
    with pytest.raises(InputError, match=r"bad\.dbc: is no CAN database"):
        read_table(log, tmp_path / "bad.dbc")
    (tmp_path / "other.dbc").write_text(DBC.replace("385", "100").replace("641", "101"))
    with pytest.raises(InputError, match=r"no message that other\.dbc describes"):
        read_table(log, tmp_path / "other.dbc")
