"""Every kind of run through the service, on the stepped clock: what is kept of it, STOP, and the order on one bus."""

from __future__ import annotations

import hashlib
import io
import json
import time
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_desk import ADDRESS, STROKE, ServiceDesk, service_desk

from schwung.errors import InputError
from schwung.service.stop_listener import StopListener
from schwung.service.values import RunView

HOST = {"host": "127.0.0.1:8737"}
LOG = "bus.log"
EDS = Path(__file__).parents[2] / "device_profiles" / "schwung-bench" / "schwung-bench.eds"


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceDesk]:
    with service_desk(tmp_path_factory.mktemp("service"), log=tmp_path_factory.mktemp("log") / LOG) as made:
        yield made


@dataclass(frozen=True)
class Story:
    """A commissioning as a client saw it."""

    plan: Mapping[str, Any]
    asked: Mapping[str, Any]
    seen: Mapping[str, Any]  # the first live samples
    run: RunView

    @property
    def result(self) -> Mapping[str, Any]:
        assert self.run.result is not None, self.run.error
        return self.run.result

    @property
    def estimate_id(self) -> str:
        return str(self.result["estimate_id"])


@pytest.fixture(scope="module")
def story(desk: ServiceDesk) -> Story:
    with desk.client() as client:
        planned = client.post("/api/runs", json={"kind": "plan", "drive_id": desk.drive_id, **STROKE})
        assert planned.status_code == 202
        plan = desk.ended(planned.json()["id"]).result
        assert plan is not None
        asked = {"kind": "commission", "proposal_id": plan["proposal_id"], "digest": plan["digest"]}
        with client.websocket_connect(f"/api/drives/{desk.drive_id}/live?points=100", headers=HOST) as scope:
            run_id = client.post("/api/runs", json=asked).json()["id"]
            seen = scope.receive_json()
    return Story(plan, asked, seen, desk.ended(run_id))


@pytest.mark.long
def test_a_commissioning_is_planned_confirmed_carried_out_and_kept(desk: ServiceDesk, story: Story) -> None:
    assert story.plan["can_start"]
    assert story.plan["predicted"]["excited"]["peak_torque_nm"] <= story.plan["limits"]["torque_max_nm"]
    assert 0 < len(story.seen["time_s"]) == len(story.seen["torque_nm"]) <= 100
    assert max(abs(position) for position in story.seen["position_rad"]) < 4
    assert (story.run.state, story.run.error) == ("done", None)
    assert story.result["verdict"] in ("good", "doubtful")
    with desk.client() as client:
        assert client.get(f"/api/runs/{story.run.id}").json()["result"] == story.result
        for file in client.get(f"/api/runs/{story.run.id}/files").json():
            content = client.get(f"/api/files/{file['id']}").content
            assert hashlib.sha256(content).hexdigest() == file["sha256"]
        assert client.post("/api/runs", json=story.asked).status_code == 409  # it is used
    again = desk.ask("estimate", session_id=story.result["session_id"], method="denoised")
    assert again.result is not None, again.error
    assert desk.service.store.estimate(again.result["estimate_id"]).session_id == story.result["session_id"]
    assert desk.service.trail.verify() is None


def test_another_digest_than_that_of_what_was_shown_is_refused(desk: ServiceDesk) -> None:
    made = desk.proposed()
    with desk.client() as client:
        wanted = {"kind": "commission", "proposal_id": made["proposal_id"], "digest": "0" * 64}
        answer = client.post("/api/runs", json=wanted)
    assert answer.status_code == 409
    assert answer.headers["content-type"] == "application/problem+json"


def test_stop_ends_what_moves_and_holds_until_it_is_released(desk: ServiceDesk) -> None:
    run = desk.confirmed(repeats=50)
    end = time.monotonic() + 20
    while "Motion" not in desk.phase(run.id):
        assert time.monotonic() < end
        time.sleep(0.002)
    with desk.client(token=False) as client:
        assert client.post("/api/stop").json()["stopped"]
        ended = desk.ended(run.id)
        assert ended.state == "cancelled"
        assert client.post("/api/release").status_code == 401
    assert not desk.bench.axis.energised
    with desk.client() as client:
        made = desk.proposed()  # looking is allowed
        wanted = {"kind": "commission", "proposal_id": made["proposal_id"], "digest": made["digest"]}
        assert client.post("/api/runs", json=wanted).status_code == 409
        assert client.post("/api/release").json() == {"stopped": False, "who": None, "at": None}
        again = client.post("/api/runs", json=wanted)
        assert again.status_code == 202
        desk.service.cancel(again.json()["id"], "tester")
        desk.ended(again.json()["id"])


def test_stop_has_a_listener_of_its_own_which_knows_its_pages(desk: ServiceDesk) -> None:
    listener = StopListener(desk.service, desk.guard, "127.0.0.1", 0)
    url = f"http://127.0.0.1:{listener.port}/stop"
    try:
        assert httpx.post(url, headers={"Origin": "http://evil.example"}).status_code == 403
        assert httpx.post(url, headers={"Host": "evil.example"}).status_code == 403
        assert desk.service.latch.stopped is None
        answer = httpx.post(url, headers={"Origin": ADDRESS, "Schwung-Who": "Ada"})
        assert (answer.status_code, answer.json()["who"]) == (200, "Ada")
        assert answer.headers["access-control-allow-origin"] == ADDRESS
        assert desk.service.latch.stopped is not None
    finally:
        listener.close()
        desk.service.release("tester")


def test_looking_changes_nothing_and_tells_much(desk: ServiceDesk) -> None:
    scan = desk.ask("scan", bus="bench", first=1, last=3)
    assert scan.result is not None, scan.error
    assert [node["node_id"] for node in scan.result["nodes"]] == [1]
    doctor = desk.ask("doctor", drive_id=desk.drive_id)
    assert doctor.result is not None, doctor.error
    assert doctor.result["can_start"]
    kept = desk.ask("backup", drive_id=desk.drive_id)
    assert kept.result is not None, kept.error
    assert kept.result["parameters"] > 20
    assert [file.name for file in desk.service.store.files(kept.id)] == ["drive.dcf"]
    file = desk.service.store.files(kept.id)[0]
    back = desk.ask("propose_restore", drive_id=desk.drive_id, file_id=file.id)
    assert back.result is not None, back.error
    assert back.result["changes"] == []
    apart = desk.ask("diff", drive_id=desk.drive_id, file_id=file.id)
    assert apart.result is not None, apart.error
    assert apart.result["diff"]["different"] == []
    assert apart.result["diff"]["equal"] == kept.result["parameters"]
    assert desk.service.status(desk.drive_id).connected


@pytest.mark.long
def test_the_log_of_a_commissioning_is_a_session_too(desk: ServiceDesk, story: Story) -> None:
    desk.ask("scan", bus="bench", first=5, last=5)  # the bus is closed for it, and the log with it
    named = desk.service.settings.buses[0].options.log
    assert named is not None
    # every time that the bus is opened it gets a log of its own: the one that is meant is the longest
    log = max(named.parent.glob("bus*.log"), key=lambda path: path.stat().st_size)
    with desk.client() as client:

        def brought(path: Path, **form: str) -> RunView:
            answer = client.post("/api/imports", files={"file": (path.name, path.read_bytes())}, data=form)
            return desk.ended(answer.json()["id"])

        alone = brought(log, what="can_log")
        assert alone.error is not None
        assert "EDS" in alone.error["remedy"]
        eds = brought(EDS, what="eds")
        assert eds.result is not None
        run = brought(log, what="can_log", eds_file_id=eds.result["file_id"])
    assert run.state == "done", run.error
    recorded = desk.service.store.session(desk.service.store.estimate(story.estimate_id).session_id or "")
    assert run.result is not None
    assert run.result["excited"] >= recorded.document["excited"]
    assert run.result["duration_s"] > 0.9 * recorded.document["duration_s"]  # the log's rests are cut


def test_an_export_is_shown_confirmed_written_and_can_be_put_back(desk: ServiceDesk, story: Story) -> None:
    shown = desk.ask(
        "propose_export", drive_id=desk.drive_id, estimate_id=story.estimate_id, form="mean", store=False
    )
    assert shown.result is not None, shown.error
    changes = shown.result["changes"]
    assert changes
    confirmed = {key: shown.result[key] for key in ("proposal_id", "digest")}
    done = desk.ask("export", who="Ada", **confirmed)
    assert done.result is not None, done.error
    assert [c["new"] for c in done.result["changes"]] == [c["new"] for c in changes if c["new"] != c["old"]]
    assert desk.service.store.unsettled() == []  # it is what was wanted
    assert desk.service.trail.entries()[-1].action == "written"
    backup = next(f for f in desk.service.store.files(done.id) if f.name == "export.backup.json")
    way_back = desk.ask("propose_restore", drive_id=desk.drive_id, file_id=backup.id)
    assert way_back.result is not None, way_back.error
    undone = desk.ask("restore", **{key: way_back.result[key] for key in ("proposal_id", "digest")})
    assert undone.state == "done", undone.error


def test_an_archive_opens_anywhere_and_proves_itself(desk: ServiceDesk, story: Story) -> None:
    run_id = desk.service.store.estimate(story.estimate_id).run_id
    with desk.client() as client:
        content = client.get(f"/api/runs/{run_id}/archive").content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        sums = dict(reversed(line.split("  ")) for line in archive.read("SHA256SUMS").decode().splitlines())
        assert set(archive.namelist()) == {*sums, "SHA256SUMS"}
        assert {"session.h5", "report.html", "machine/machine.toml", "README.txt"} <= set(sums)
        for name, digest in sums.items():
            assert hashlib.sha256(archive.read(name)).hexdigest() == digest
        before = "0" * 64
        for entry in json.loads(archive.read("trail.json"))["entries"]:
            told = entry.pop("hash")
            assert entry["before"] == before
            text = json.dumps(entry, sort_keys=True, ensure_ascii=False).encode()
            assert hashlib.sha256(text).hexdigest() == told
            before = told


def test_a_drive_is_known_by_what_it_said_changed_by_name_and_archived_when_free(desk: ServiceDesk) -> None:
    desk.proposed()
    with desk.client() as client:
        drive = client.get(f"/api/drives/{desk.drive_id}").json()
        assert drive["identity"]["name"] == "Schwung bench drive"
        renamed = client.patch(f"/api/drives/{drive['id']}", json={"name": "X axis"})
        assert renamed.json()["name"] == "X axis"
        for wrong in ({"name": None}, {"profile": "../x"}, {"machine_id": "0" * 16}, {"bus": "other"}):
            assert client.patch(f"/api/drives/{drive['id']}", json=wrong).status_code in (404, 422)
        other = client.post("/api/drives", json={"name": "Y", "bus": "bench", "node_id": 9}).json()
        assert client.delete(f"/api/drives/{other['id']}").status_code == 204
        assert [one["id"] for one in client.get("/api/drives").json()] == [drive["id"]]


def test_two_on_one_drive_go_one_after_the_other(desk: ServiceDesk) -> None:
    first, second = desk.confirmed(repeats=3), desk.service.submit(
        {"kind": "doctor", "drive_id": desk.drive_id}, "Bob"
    )  # fmt: skip
    assert desk.service.run(second.id).state == "queued"
    desk.service.cancel(first.id, "Ada")
    ended = desk.ended(first.id)
    assert ended.state == "cancelled"
    after = desk.ended(second.id)
    assert after.state == "done"
    assert ended.ended is not None
    assert after.started is not None
    assert ended.ended <= after.started
    assert desk.service.store.unsettled() == []  # its parameters are back


def test_a_session_goes_out_and_comes_in_again(desk: ServiceDesk, story: Story) -> None:
    session_id = desk.service.store.estimate(story.estimate_id).session_id
    assert session_id is not None
    content = desk.service.store.session_path(session_id).read_bytes()
    with desk.client() as client:
        answer = client.post("/api/imports", files={"file": ("mine.h5", content)})
        run = desk.ended(answer.json()["id"])
    assert run.result is not None, run.error
    assert run.result["excited"] == 1
    assert desk.service.store.session_path(run.result["session_id"]).read_bytes() == content


def test_what_ended_is_removed_with_its_files_and_the_trail_remembers(desk: ServiceDesk) -> None:
    run = desk.ask("scan", bus="bench", first=5, last=5)
    folder = desk.service.store.run_folder(run.id)
    with desk.client() as client:
        assert client.delete(f"/api/runs/{run.id}").status_code == 204
        assert client.get(f"/api/runs/{run.id}").status_code == 404
        assert client.get("/api/trail/check").json()["whole"]
    assert not folder.exists()
    assert desk.service.trail.entries()[-1].detail["kind"] == "scan"


def test_frequency_response_is_proposed_confirmed_and_fitted(desk: ServiceDesk) -> None:
    shown = desk.ask(
        "propose_bode", drive_id=desk.drive_id, angles_rad=[0.2], repeats=1, periods=2, waveform="multisine"
    )
    assert shown.result is not None, shown.error
    assert shown.result["can_start"]
    done = desk.ask("bode", **{key: shown.result[key] for key in ("proposal_id", "digest")})
    assert done.result is not None, done.error
    assert done.result["bode"]["proposal"]["frequency_hz"] > 0
    again = desk.proposed(bode_run_id=done.id, sample_rate_hz=1000.0)  # of so high a frequency
    assert again["excitation"]["frequency_hz"] == pytest.approx(
        done.result["bode"]["proposal"]["frequency_hz"]
    )


def test_what_computes_tells_how_far_it_is_and_ends_when_cancelled(desk: ServiceDesk, story: Story) -> None:
    session_id = desk.service.store.estimate(story.estimate_id).session_id
    run = desk.service.submit({"kind": "explain", "session_id": session_id}, "Ada")
    end = time.monotonic() + 60
    while desk.phase(run.id) in ("", "begun", "waiting for its turn"):
        assert time.monotonic() < end
        time.sleep(0.01)
    desk.service.cancel(run.id, "Ada")
    assert desk.ended(run.id, within_s=5).state == "cancelled"
    with pytest.raises(InputError, match="cancelled already"):
        desk.service.cancel(run.id, "Ada")
