"""Through the API on the stepped clock: plan, confirm, commission, look at what is kept; and STOP."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator

import httpx
import pytest
from service_desk import ADDRESS, STROKE, ServiceDesk, service_desk

from schwung.service.stop_listener import StopListener

HOST = {"host": "127.0.0.1:8737"}


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceDesk]:
    with service_desk(tmp_path_factory.mktemp("service")) as made:
        yield made


def test_a_commissioning_is_planned_confirmed_carried_out_and_kept(desk: ServiceDesk) -> None:
    with desk.client() as client:
        asked = client.post("/api/runs", json={"kind": "plan", "drive_id": desk.drive_id, **STROKE})
        assert asked.status_code == 202
        plan = desk.ended(asked.json()["id"]).result
        assert plan is not None
        assert plan["can_start"]
        assert plan["predicted"]["excited"]["peak_torque_nm"] <= plan["limits"]["torque_max_nm"]
        wanted = {"kind": "commission", "proposal_id": plan["proposal_id"], "digest": plan["digest"]}
        with client.websocket_connect(f"/api/drives/{desk.drive_id}/live?points=100", headers=HOST) as scope:
            run_id = client.post("/api/runs", json=wanted).json()["id"]
            seen = scope.receive_json()
        run = desk.ended(run_id)
        assert 0 < len(seen["time_s"]) == len(seen["torque_nm"]) <= 100
        assert max(abs(p) for p in seen["position_rad"]) < 4
        assert (run.state, run.error) == ("done", None)
        shown = client.get(f"/api/runs/{run_id}").json()
        assert shown["result"]["verdict"] in ("good", "doubtful")
        for file in client.get(f"/api/runs/{run_id}/files").json():
            content = client.get(f"/api/files/{file['id']}").content
            assert hashlib.sha256(content).hexdigest() == file["sha256"]
        assert client.post("/api/runs", json=wanted).status_code == 409  # it is used
        session_id = shown["result"]["session_id"]
        again = desk.ask("estimate", session_id=session_id)
        assert again.state == "done", again.error
        assert again.result is not None
        assert again.result["verdict"] == shown["result"]["verdict"]
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
        assert client.post("/api/runs", json=wanted).status_code == 202


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
