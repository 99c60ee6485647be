"""Every drive is commissioned end to end on its own dictionary, or refused in plain words before anything moves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conformance_rooms import Room

from schwung.commissioning import LimitWishes, ParameterJournal, Wishes, prepare
from schwung.commissioning.commission import settings_of
from schwung.commissioning.procedure import record
from schwung.drivetrain import Control, Coupling, Load, Machine, Motor
from schwung.errors import InputError, RefusedError
from schwung.estimation import Estimate, estimate
from schwung.fieldbus.drive import ParameterValue
from schwung.session import read_session

#: where drive or profile leave a limit open, the user gives it
LIMITS = LimitWishes(-10.0, 10.0, 60.0, 200.0, 0.5)
WISHES = Wishes(np.pi, 0.25, limits=LIMITS, repeats=1, trace_rate_hz=2000.0)
#: what commissioning cannot do without: any one of each row
NEEDS = (
    ("cyclic position", "profile position"),
    ("torque",),
    ("torque injection", "generator"),
    ("sampling by SYNC", "trace buffer"),
)


class Silence:
    """An observer that looks away."""

    def phase(self, text: str) -> None: ...

    def progress(self, done: int, total: int) -> None: ...

    def note(self, text: str) -> None: ...


def believed() -> Machine:
    """Data sheets, and a guess of the load."""
    return Machine(
        name="bench machine",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.11),
        control=Control(
            position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=0.02, sample_rate_hz=8000.0
        ),
    )


def missing(room: Room) -> list[str]:
    """Reasons why this drive cannot be commissioned; empty where it can."""
    lacking = [names for names in NEEDS if not any(room.offers(name) for name in names)]
    return [why(room, name) for names in lacking for name in names]


def why(room: Room, name: str) -> str:
    """The reason without the phrase before it."""
    reason = next(c.reason for c in room.drive.capabilities() if c.name == name)
    return reason.partition("because ")[2] or reason


@pytest.fixture(autouse=True)
def unpredicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What preflight foretells of the estimate is the same for every drive, takes seconds, and is tested elsewhere."""
    monkeypatch.setattr("schwung.commissioning.preflight._predicted", lambda *_: None)


def test_it_is_commissioned_or_refused_in_plain_words(room: Room, tmp_path: Path) -> None:
    before = room.held()
    reasons = missing(room)
    if reasons:
        with pytest.raises((RefusedError, InputError)) as refused:
            commission(room, tmp_path)
        assert any(reason in str(refused.value) for reason in reasons), refused.value
        assert not room.axis.energised
        assert abs(room.axis.position_rad) < 0.01
    else:
        agrees_with_the_truth(room, commission(room, tmp_path))
    assert room.held() == before


@pytest.mark.parametrize(
    ("wishes", "needs"),
    [
        (replace(WISHES, sampling="trace"), ["trace buffer"]),
        (replace(WISHES, injecting="generator"), ["generator"]),
        (
            replace(WISHES, mode="pp", sampling="trace", injecting="generator"),
            ["profile position", "trace buffer", "generator"],
        ),
    ],
    ids=["trace", "generator", "all by itself"],
)
def test_its_own_means_serve_or_are_refused_in_plain_words(
    room: Room, wishes: Wishes, needs: list[str], tmp_path: Path
) -> None:
    if not room.offers("sampling by SYNC") and not room.offers("torque injection") and not missing(room):
        pytest.skip("knows no other way than by itself")
    lacking = [why(room, name) for name in needs if not room.offers(name)]
    if not lacking and not missing(room):
        agrees_with_the_truth(room, commission(room, tmp_path, wishes))
        return
    with pytest.raises((RefusedError, InputError)) as refused:
        commission(room, tmp_path, wishes)
    assert any(reason in str(refused.value) for reason in lacking + missing(room)), refused.value
    assert not room.axis.energised


def agrees_with_the_truth(room: Room, found: Estimate) -> None:
    """Within its band, or said to be doubtful: a drive that reports whole rpm or 3200 counts a turn leaves a doubt."""
    error = found.table.inertia_kgm2 - room.plant.true_inertia(found.table.position_rad)
    rms = np.sqrt(np.mean(error**2))
    if found.trust.verdict == "good":
        assert rms < 0.003
        assert found.table.std_kgm2 is not None
        assert np.mean(np.abs(error) < 3 * found.table.std_kgm2) > 0.9
    else:
        resolution = room.drive.resolution()
        assert resolution.position_rad > 1e-3
        assert resolution.speed_rad_s > 0.05
        assert rms < 0.02


def commission(room: Room, out: Path, wishes: Wishes = WISHES) -> Estimate:
    """All of it, but with the one estimate that is quickly made."""
    with widened(room):
        return _commission(room, out, wishes)


@contextmanager
def widened(room: Room) -> Iterator[None]:
    """What preflight's remedy asks of a drive whose following error window is too narrow for this motion."""
    window = room.drive.limits().following_error_rad
    if window is None or window >= 0.5:
        yield
        return
    before = room.drive.read(room.drive.parameter(0x6065))
    wide = round(0.6 / room.drive.resolution().position_rad)
    room.drive.write([ParameterValue(before.parameter, wide)])
    yield
    room.drive.write([before])


def _commission(room: Room, out: Path, wishes: Wishes) -> Estimate:
    ready = prepare(room.drive, room.profile, believed(), wishes)
    journal = ParameterJournal(room.drive, out / "setup.backup.json", room.drive.describe())
    record(
        room.drive,
        ready.plan,
        ready.preflight,
        session_path=out / "session.h5",
        journal=journal,
        observer=Silence(),
        settings=settings_of(ready.plan),
    )
    return estimate(read_session(out / "session.h5"), ready.machine, "denoised", remove_delay=False)
