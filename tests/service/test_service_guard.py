"""Who may: tokens, hosts, origins, and how much may be sent; every refusal a problem as RFC 9457 has it."""

from __future__ import annotations

import json
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import pytest
from fastapi.testclient import TestClient
from service_desk import ADDRESS, settings_for
from starlette.websockets import WebSocketDisconnect

from schwung.errors import InputError
from schwung.service.app import make_app
from schwung.service.guard import Guard, own_token
from schwung.service.service import Service
from schwung.service.values import MAX_BODY_BYTES

MACHINE = {"name": "m", "toml": "[motor]\ninertia = 1"}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with Service(settings_for(tmp_path_factory.mktemp("guard"))) as made:
        yield made


def client_of(service: Service, address: str = ADDRESS, **settings: Any) -> TestClient:
    guard = Guard(settings_for(service.settings.folder, **settings), own_token(service.settings.folder))
    return TestClient(make_app(service, guard), base_url=address, raise_server_exceptions=False)


def bearer(service: Service) -> dict[str, str]:
    return {"Authorization": f"Bearer {own_token(service.settings.folder)}"}


def assert_problem(answer: Any, status: int) -> None:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert (body["status"], body["type"]) == (status, "about:blank")
    assert body["title"]
    assert body["detail"]


def test_looking_needs_no_token_on_this_computer_and_everything_else_does(service: Service) -> None:
    client = client_of(service)
    for path in ("/api/runs", "/api/drives", "/api/machines", "/api/trail", "/api/stop", "/api/health"):
        assert client.get(path).status_code == 200
    for method, path in (("POST", "/api/runs"), ("POST", "/api/machines"), ("POST", "/api/release"),
                         ("DELETE", "/api/runs/0123456789abcdef"), ("POST", "/api/imports"),
                         ("PUT", "/anything")):  # fmt: skip
        assert_problem(client.request(method, path), 401)
        wrong = {"Authorization": "Bearer " + "x" * 43}
        assert_problem(client.request(method, path, headers=wrong), 401)
    assert client.get("/api/stop").json()["stopped"] is False


def test_reached_from_elsewhere_everything_needs_the_token_but_stop(service: Service) -> None:
    client = client_of(service, "http://lab-pc:8737", host="0.0.0.0", names=("lab-pc",))
    assert_problem(client.get("/api/runs"), 401)
    assert client.get("/api/runs", headers=bearer(service)).status_code == 200
    assert client.post("/api/stop").status_code == 200
    service.release("tester")


def test_a_login_sets_a_cookie_that_scripts_and_other_sites_do_not_get(service: Service) -> None:
    client = client_of(service)
    assert_problem(client.get("/login?token=wrong"), 401)
    answer = client.get(f"/login?token={own_token(service.settings.folder)}&who=Ada", follow_redirects=False)
    assert answer.status_code == 303
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert client.post("/api/machines", json=MACHINE).status_code == 422  # it is heard, and no machine


def test_who_somebody_is_may_have_any_letters(service: Service) -> None:
    client = client_of(service)
    token = own_token(service.settings.folder)
    answer = client.get("/login", params={"token": token, "who": "Łukasz; Ω=1"}, follow_redirects=False)
    assert answer.status_code == 303
    client.post("/api/release")
    assert service.trail.entries()[-1].who == "Łukasz; Ω=1"
    client.post("/api/release", headers={"Schwung-Who": "J%C3%BCrgen%0A"})
    assert service.trail.entries()[-1].who == "Jürgen"


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "127.0.0.1:9999", "", "[::1", "a b"]
)
def test_other_host_names_are_not_ours(service: Service, host: str) -> None:
    assert_problem(client_of(service).get("/api/runs", headers={"Host": host}), 421)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:8000", "file://", "javascript:1"]
)
def test_pages_of_other_origins_may_neither_act_nor_stop(service: Service, origin: str) -> None:
    client = client_of(service)
    for path in ("/api/runs", "/api/stop", "/api/release"):
        assert_problem(client.post(path, headers={"Origin": origin, **bearer(service)}), 403)
    assert service.latch.stopped is None
    own = {"Origin": ADDRESS, **bearer(service)}
    assert client.post("/api/release", headers=own).status_code == 200


def test_web_sockets_of_other_origins_are_closed(service: Service) -> None:
    client = client_of(service)
    headers = {"host": "127.0.0.1:8737", "origin": "http://evil.example"}
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/api/events", headers=headers):
        pass


def test_bodies_are_bounded_whatever_they_announce(service: Service) -> None:
    client = client_of(service)
    long = b"x" * (MAX_BODY_BYTES + 1)
    assert_problem(client.post("/api/machines", content=long, headers=bearer(service)), 413)

    def pieces() -> Iterator[bytes]:
        for _ in range(MAX_BODY_BYTES // 65536 + 1):
            yield b"x" * 65536

    answer = client.post("/api/machines", content=pieces(), headers=bearer(service))
    assert_problem(answer, 413)


@pytest.mark.parametrize(
    "body",
    [
        b"", b"{", b"[]", b"null", b'{"kind": "commission"}', b'{"kind": "no such kind"}', b'{"kind": ["plan"]}',
        b'{"kind": "estimate", "session_id": "../../../etc/passwd"}',
        b'{"kind": "estimate", "session_id": "0123456789abcdef"}',
        b'{"kind": "plan", "drive_id": "0123456789abcdef", "distance_rad": NaN, "duration_s": 1}',
        b'{"kind": "plan", "drive_id": "0123456789abcdef", "distance_rad": 1e400, "duration_s": 1}',
        b'{"kind": "scan", "bus": "/dev/ttyUSB0"}', b'{"kind": "salvage", "run_id": "0123456789abcdef"}',
        b'{"kind": "import", "what": "session", "name": "../x.h5"}', b'{"kind": "estimate", "path": "/etc/passwd"}',
        b"\xff\xfe", b'{"kind":' + b"[" * 5000,
    ],
)  # fmt: skip
def test_what_is_no_request_is_a_problem_and_no_run(service: Service, body: bytes) -> None:
    client, before = client_of(service), len(service.runs())
    headers = {"Content-Type": "application/json", **bearer(service)}
    answer = client.post("/api/runs", content=body, headers=headers)
    assert answer.status_code in (400, 404, 422), answer.text
    assert_problem(answer, answer.status_code)
    assert len(service.runs()) == before


@pytest.mark.parametrize(
    ("machine", "told"),
    [
        ({"toml": "not = toml ="}, "TOML"),
        ({"toml": "name = 'm'\n[motor]\ninertia = -1"}, "motor"),
        ({"toml": '[load]\ninertia_table = "/etc/passwd"\nviscous_friction = 0.1'}, "did not come along"),
        (
            {"toml": '[load]\ninertia_table = "../x"\nviscous_friction = 0.1', "inertia_table": "x"},
            "inertia.csv",
        ),
        ({"toml": "[motor]", "torque_table": "x"}, "is not there"),
        ({"toml": "x" * 300_000}, "toml"),
    ],
)
def test_machines_that_are_not_sound_leave_nothing(
    service: Service, machine: dict[str, str], told: str
) -> None:
    answer = client_of(service).post("/api/machines", json={"name": "m", **machine}, headers=bearer(service))
    assert_problem(answer, 422)
    assert told in answer.json()["detail"]
    assert str(service.settings.folder) not in answer.text
    assert list((service.settings.folder / "machines").iterdir()) == []


def test_uploads_that_are_no_sessions_fail_with_a_sentence(service: Service, tmp_path: Path) -> None:
    linked = tmp_path / "linked.h5"
    with h5py.File(linked, "w") as file:
        file.attrs["format"], file.attrs["version"] = "schwung-session", 1
        file["run"] = h5py.ExternalLink("/etc/passwd", "/")
    stored = tmp_path / "stored.h5"
    with h5py.File(stored, "w") as file:
        file.create_dataset("run/0000/time", (10,), "f8", external=[("/etc/passwd", 0, 80)])
    client = client_of(service)
    contents = {b"": "no HDF5", b"\x89HDF\r\n\x1a\n" + b"\0" * 100: "no HDF5", linked.read_bytes(): "elsewhere",
                stored.read_bytes(): "another file"}  # fmt: skip
    for content, told in contents.items():
        answer = client.post("/api/imports", files={"file": ("../../x.h5", content)}, headers=bearer(service))
        assert answer.status_code == 202
        run = answer.json()
        while (run := client.get(f"/api/runs/{run['id']}").json())["state"] in ("queued", "running"):
            time.sleep(0.02)
        assert run["state"] == "failed"
        assert told in run["error"]["text"], run["error"]
        assert str(service.settings.folder) not in run["error"]["text"]
    for name, what, options in (("x.exe", "session", "{}"), ("x.csv", "recording", "["), ("x.csv", "recording", "[]"),
                                ("x.csv", "recording", '{"dbc": "/etc/passwd"}'), ("x", "nothing", "{}")):  # fmt: skip
        form = {"what": what, "options": options}
        refused = client.post(
            "/api/imports", files={"file": (name, b"x")}, data=form, headers=bearer(service)
        )
        assert_problem(refused, 422)


@pytest.mark.posix
def test_the_token_is_for_its_owner_and_a_damaged_one_is_told(tmp_path: Path) -> None:
    token = own_token(tmp_path)
    assert own_token(tmp_path) == token
    assert stat.S_IMODE((tmp_path / "token").stat().st_mode) == 0o600
    (tmp_path / "token").write_text("short")
    with pytest.raises(InputError, match="holds no token"):
        own_token(tmp_path)


def test_every_answer_is_described_as_a_problem(service: Service) -> None:
    document = client_of(service).get("/api/openapi.json").json()
    assert json.dumps(document).count("application/problem+json") > 50
    for path, operations in document["paths"].items():
        for operation in operations.values():
            assert operation["summary"], path
