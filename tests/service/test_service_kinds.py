"""Every further kind of run through the service, on the stepped clock; two on one drive go one after the other."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator

import pytest
from service_desk import ServiceDesk, service_desk


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceDesk]:
    with service_desk(tmp_path_factory.mktemp("kinds")) as made:
        yield made


@pytest.fixture(scope="module")
def estimate_id(desk: ServiceDesk) -> str:
    run = desk.ended(desk.confirmed().id)
    assert run.result is not None, run.error
    return str(run.result["estimate_id"])


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
    assert desk.service.status(desk.drive_id).connected


def test_an_export_is_shown_confirmed_written_and_can_be_put_back(
    desk: ServiceDesk, estimate_id: str
) -> None:
    shown = desk.ask(
        "propose_export", drive_id=desk.drive_id, estimate_id=estimate_id, form="mean", store=False
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


def test_an_archive_opens_anywhere_and_proves_itself(desk: ServiceDesk, estimate_id: str) -> None:
    run_id = desk.service.store.estimate(estimate_id).run_id
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


def test_a_session_goes_out_and_comes_in_again(desk: ServiceDesk, estimate_id: str) -> None:
    session_id = desk.service.store.estimate(estimate_id).session_id
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
