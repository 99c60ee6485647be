"""Every drive takes an inertia in the form that it has, so that its feed-forward knows it, or says why it cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conformance_rooms import Room

from schwung.commissioning import ExportChoice, export_table, restore_backup
from schwung.drivetrain import InertiaTable
from schwung.errors import InputError
from schwung_sim.drives.axis import FEED_FORWARD_OFF, FEED_FORWARD_SCALAR, FEED_FORWARD_TABLE

ROTOR_KGM2 = 0.012  # of the bench's machine
ANGLES = np.linspace(0, 2 * np.pi, 61)
TABLE = InertiaTable(ANGLES, 0.11 + 0.03 * np.cos(ANGLES - 0.4) + 0.01 * np.cos(2 * ANGLES))
FORMS = {"table": "table feed-forward", "mean": "scalar feed-forward", "harmonics": "harmonic feed-forward"}


@pytest.mark.parametrize("form", FORMS)
def test_an_inertia_arrives_where_the_feed_forward_is_or_is_refused(
    room: Room, form: str, tmp_path: Path
) -> None:
    choice, name = ExportChoice(form), FORMS[form]  # type: ignore[arg-type]  # one of the forms
    backup = tmp_path / "export.backup.json"
    before, settings = room.held(), room.axis.settings
    if not room.offers(name):
        with pytest.raises(InputError) as refused:
            export_table(room.drive, room.profile, TABLE, choice, backup_path=backup, store=False)
        reason = room.profile.cannot.get(name)  # type: ignore[call-overload]  # one of the names
        assert reason is not None
        assert reason in str(refused.value)
        assert room.held() == before
        return
    done = export_table(
        room.drive,
        room.profile,
        TABLE,
        choice,
        backup_path=backup,
        store=False,
        motor_inertia_kgm2=ROTOR_KGM2,
    )
    assert done.changes
    now = room.axis.settings
    if form == "mean":
        assert now.feed_forward_mode == FEED_FORWARD_SCALAR
        assert now.scalar_inertia_kgm2 == pytest.approx(0.11, abs=2e-4)
    else:
        assert now.feed_forward_mode == FEED_FORWARD_TABLE
        angles = now.table_start_rad + now.table_step_rad * np.arange(len(now.table_inertia_kgm2))
        turn = (angles >= 0) & (angles <= 2 * np.pi)
        assert np.sum(turn) > 10
        assert np.asarray(now.table_inertia_kgm2)[turn] == pytest.approx(TABLE.at(angles[turn]), abs=1e-3)
    restore_backup(room.drive, backup)
    assert room.held() == before
    assert room.axis.settings.feed_forward_mode == settings.feed_forward_mode == FEED_FORWARD_OFF
