"""After a death: what was cut off is found, the drive is secured, nothing moves before it is as it was or somebody
declines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest
from service_desk import ServiceDesk, settings_for

from schwung.commissioning import ParameterJournal
from schwung.errors import RefusedError
from schwung.fieldbus.canopen import BusOptions
from schwung.fieldbus.connecting import connected
from schwung.fieldbus.drive import ParameterValue
from schwung.service.guard import Guard, own_token
from schwung.service.service import Service
from schwung.service.store import Store
from schwung_sim.bench import Bench

_channels = count()


@contextmanager
def dead_service(folder: Path, *, powered: bool = False) -> Iterator[ServiceDesk]:
    """A service that starts where an earlier one was killed while its run had changed the following error window."""
    channel = f"dead {next(_channels)}"
    with Bench("two-mass", channel=channel, node_id=1) as bench:
        settings = settings_for(folder, channel)
        with Service(settings) as first:
            drive_id = first.store.drives()[0].id
        store = Store(folder)
        run = store.add_run("commission", {"kind": "commission"}, "Ada", drive_id, None)
        waiting = store.add_run("commission", {"kind": "commission"}, "Bob", drive_id, None)
        store.begin_run(run.id)
        with connected(BusOptions("stepped", channel, 1_000_000), 1, "schwung-bench") as found:
            drive = found.drive
            journal = ParameterJournal(
                drive, store.run_folder(run.id) / "setup.backup.json", drive.describe()
            )
            window = drive.parameter(0x6065)
            journal.change([ParameterValue(window, int(drive.read(window).raw) // 2)])
        store.close()
        if powered:
            bench.servo.axis.energise(True)
        with Service(settings) as service:
            desk = ServiceDesk(service, Guard(settings, own_token(folder)), bench)
            desk.cut, desk.waiting = run.id, waiting.id  # type: ignore[attr-defined]
            for secured in service.runs(kind="secure"):
                desk.ended(secured.id)
            yield desk


def window_of(desk: ServiceDesk) -> int:
    """The bench's following error window, counts, read over its bus by a run of its own kind."""
    lane = desk.service._lanes["bench"]
    read: list[int] = []
    lane.put(lambda: read.append(int(_window(desk))))
    while not read:
        pass
    return read[0]


def _window(desk: ServiceDesk) -> int:
    drive = desk.service._lanes["bench"].connect(desk.service.store.drives()[0]).drive
    return int(drive.read(drive.parameter(0x6065)).raw)


def test_what_was_cut_off_is_found_secured_and_put_back(tmp_path: Path) -> None:
    with dead_service(tmp_path) as desk:
        service = desk.service
        assert service.run(desk.cut).state == "interrupted"  # type: ignore[attr-defined]
        assert service.run(desk.waiting).state == "cancelled"  # type: ignore[attr-defined]
        (left,) = service.store.unsettled(desk.drive_id)
        assert left.found == "Switch on disabled"
        changed = window_of(desk)
        made = desk.proposed()  # looking is allowed, moving is not
        confirmed = {"kind": "commission", "proposal_id": made["proposal_id"], "digest": made["digest"]}
        with pytest.raises(RefusedError, match="interrupted run has changed"):
            service.submit(confirmed, "Ada")
        proposed = desk.ask("propose_restore", drive_id=desk.drive_id, unsafe_id=left.id)
        assert proposed.result is not None, proposed.error
        assert [change["old"] for change in proposed.result["changes"]] == [changed]
        confirmed = {key: proposed.result[key] for key in ("proposal_id", "digest")}
        back = desk.ask("restore", **confirmed)
        assert back.state == "done", back.error
        assert window_of(desk) == 2 * changed
        assert service.store.unsettled() == []
        actions = [entry.action for entry in service.trail.entries()]
        assert actions[-2:] == ["restore", "put back"]
        assert service.trail.verify() is None


def test_somebody_may_decline_by_name(tmp_path: Path) -> None:
    with dead_service(tmp_path) as desk:
        (left,) = desk.service.store.unsettled()
        with desk.client() as client:
            assert client.post(f"/api/unsafe/{'0' * 16}/decline").status_code == 404
            answer = client.post(f"/api/unsafe/{left.id}/decline", headers={"Schwung-Who": "Grace"})
        assert answer.status_code == 204
        assert desk.service.store.unsettled() == []
        assert desk.service.trail.entries()[-1].who == "Grace"


def test_what_changed_since_it_was_shown_is_not_written(tmp_path: Path) -> None:
    with dead_service(tmp_path) as desk:
        (left,) = desk.service.store.unsettled()
        proposed = desk.ask("propose_restore", drive_id=desk.drive_id, unsafe_id=left.id).result
        assert proposed is not None
        lane = desk.service._lanes["bench"]

        def change() -> None:
            drive = lane.connect(desk.service.store.drives()[0]).drive
            window = drive.parameter(0x6065)
            drive.write([ParameterValue(window, int(drive.read(window).raw) + 1)])

        lane.put(change)
        run = desk.ask("restore", proposal_id=proposed["proposal_id"], digest=proposed["digest"])
        assert run.state == "failed"
        assert run.error is not None
        assert "when the change was shown" in run.error["text"]


def test_a_start_after_a_start_finds_the_same_and_no_more(tmp_path: Path) -> None:
    with dead_service(tmp_path) as desk:
        before = desk.service.store.unsettled()
        settings = desk.service.settings
    with Service(settings_for(tmp_path)) as again:  # without its bus: what is left stays known
        assert [u.id for u in again.store.unsettled()] == [u.id for u in before]
        assert again.status(before[0].drive_id).trouble.startswith("the service was started without")
    assert settings.folder == tmp_path
