"""What the command line can, the service can; and what comes from outside is looked at, confirmed and taken in."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from service_desk import ADDRESS, settings_for

import schwung
from schwung.cli import app as command_line
from schwung.cli.demo import BELIEF
from schwung.service.app import make_app
from schwung.service.guard import Guard, own_token
from schwung.service.service import Service
from schwung.service.work import KINDS

PROFILES = Path(__file__).parents[2] / "device_profiles"

#: Each command, and what does it by HTTP: kinds of runs, or routes.
REACHED = {
    "scan": ("scan",),
    "doctor": ("doctor",),
    "commission": ("plan", "commission"),
    "estimate": ("estimate",),
    "explain": ("explain",),
    "export": ("propose_export", "export"),
    "backup": ("backup",),
    "restore": ("propose_restore", "restore"),
    "diff": ("diff",),
    "report": ("estimate", "GET /api/files/{file_id}"),  # every estimate writes its report
    "bode": ("propose_bode", "bode"),
    "reproduce": ("reproduce",),
    "import": ("POST /api/imports", "import_as"),
    "convert": ("convert",),
    "optimise": ("optimise", "propose_play", "play"),
    "profile list": ("GET /api/profiles",),
    "profile show": ("GET /api/profiles/{family}",),
    "profile check": ("check_profile",),
    "profile new": ("draft_profile",),
    "runs list": ("GET /api/runs",),
    "runs show": ("GET /api/runs/{run_id}", "GET /api/runs/{run_id}/archive"),
    "runs compare": ("GET /api/compare",),
    "runs prune": ("DELETE /api/runs/{run_id}",),
    "batch estimate": ("batch",),
    "batch explain": ("batch",),
}
#: Commands that HTTP does not have, and why.
EXCEPTIONS = {
    "serve": "is the service",
    "demo": "is `serve --demo` without a page: a bench, and what the wizard does with it",
    "bench": "is the other side of the bus",
}


def _commands() -> set[str]:
    names = {str(one.name) for one in command_line.registered_commands}
    for group in command_line.registered_groups:
        assert group.typer_instance is not None
        names |= {f"{group.name} {one.name}" for one in group.typer_instance.registered_commands}
    return names


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with Service(settings_for(tmp_path_factory.mktemp("reach"))) as made:
        yield made


@pytest.fixture(scope="module")
def client(service: Service) -> TestClient:
    guard = Guard(service.settings, own_token(service.settings.folder))
    headers = {"Authorization": f"Bearer {guard.token}"}
    return TestClient(make_app(service, guard), base_url=ADDRESS, headers=headers)


def test_every_command_has_its_route_or_a_reason(client: TestClient) -> None:
    document = client.get("/api/openapi.json").json()
    routes = {f"{verb.upper()} {path}" for path, verbs in document["paths"].items() for verb in verbs}
    assert _commands() == {*REACHED, *EXCEPTIONS}
    asked = {name for names in REACHED.values() for name in names}
    assert {name for name in asked if "/" in name} <= routes
    kinds = {
        part["properties"]["kind"]["const"]
        for part in document["components"]["schemas"].values()
        if "const" in part.get("properties", {}).get("kind", {})
    }
    assert {name for name in asked if "/" not in name} <= kinds
    # and nothing is there that no command asks for, but what follows on a crash or a fault
    assert kinds - asked == {"secure", "reset_fault"}
    assert set(KINDS) - kinds == {"import", "salvage"}  # asked for by an upload, and by a death


def _ended(client: TestClient, run: Any) -> Any:
    assert run.status_code == 202, run.text
    told, pause = run.json(), 0.02
    while (told := client.get(f"/api/runs/{told['id']}").json())["state"] in ("queued", "running"):
        time.sleep(pause)
        pause = min(1.2 * pause, 0.3)  # asking takes time, too, of what is waited for
    return told


def _asked(client: TestClient, **request: Any) -> Any:
    return _ended(client, client.post("/api/runs", json=request))


def _brought(client: TestClient, name: str, content: bytes, **form: str) -> Any:
    return _ended(client, client.post("/api/imports", files={"file": (name, content)}, data=form))


def _strange_csv() -> bytes:
    """Degrees and N·m under names that say nothing, at rest before and after."""
    machine = schwung.example_machine(control=True)
    made = schwung.simulate(machine, schwung.Motion(kind="poly5", distance_rad=3.0, duration_s=0.4))
    rest = np.zeros(300)
    position = np.concatenate([rest, made.position_rad, rest + made.position_rad[-1]])
    torque = np.concatenate([rest, made.torque_nm, rest])
    rows = np.column_stack([np.arange(position.size) / 1000.0, np.degrees(position), torque])
    text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
    return ("a;b;c\n".replace(";", ",") + text).encode()


@pytest.mark.long
def test_a_strange_recording_is_guessed_shown_confirmed_and_taken_in(client: TestClient) -> None:
    looked = _brought(client, "monday.csv", _strange_csv(), what="recording", guess="true")
    assert looked["state"] == "done", looked["error"]
    (proposal,) = looked["result"]["proposals"]
    files = {file["name"] for file in client.get(f"/api/runs/{looked['id']}/files").json()}
    assert files == {"recording.csv", proposal["picture"]}
    assert client.get("/api/results/session").json() == []  # nothing is taken in yet
    options = {**proposal["options"], "position_unit": "deg"}
    taken = _asked(client, kind="import_as", file_id=looked["result"]["file_id"], options=options)
    assert taken["state"] == "done", taken["error"]
    assert taken["result"]["duration_s"] > 0.3
    refused = client.post("/api/runs", json={"kind": "import_as", "file_id": looked["result"]["file_id"],
                                             "options": {"dbc": "/etc/passwd"}})  # fmt: skip
    assert "names files" in _ended(client, refused)["error"]["text"]
    converted = _asked(client, kind="convert", session_id=taken["result"]["session_id"], form="parquet")
    content = client.get(f"/api/files/{converted['result']['file_id']}").content
    again = _brought(client, "session.parquet", content, what="session")
    assert again["result"]["duration_s"] == taken["result"]["duration_s"]


def test_a_wrong_file_is_one_sentence_without_our_folders(client: TestClient, service: Service) -> None:
    for name, what, more in (
        ("x.csv", "recording", {"guess": "true"}), ("x.csv", "recording", {}), ("x.blf", "can_log", {}),
        ("x.mf4", "session", {}),
    ):  # fmt: skip
        run = _brought(client, name, b"this is no recording\n" * 3, what=what, **more)
        assert run["state"] == "failed", (name, what)
        assert run["error"]["type"] != "Defect", run["error"]
        assert run["error"]["remedy"]
        assert str(service.settings.folder) not in run["error"]["text"]


def test_families_are_listed_checked_and_drafted(client: TestClient) -> None:
    families = {one["family"] for one in client.get("/api/profiles").json()}
    assert "schwung-bench" in families
    shown = client.get("/api/profiles/schwung-bench").json()
    assert any(one["offered"] for one in shown["capabilities"])
    assert client.get("/api/profiles/..%2Fpasswd").status_code in (404, 422)
    eds = next((PROFILES / "schwung-bench").glob("*.eds")).read_bytes()
    brought = _brought(client, "vendor.eds", eds, what="eds")
    eds_id = brought["result"]["file_id"]
    checked = _asked(client, kind="check_profile", family="schwung-bench", eds_file_id=eds_id)["result"]
    assert [one for one in checked["findings"] if one["severity"] == "error"] == []
    drafted = _asked(client, kind="draft_profile", eds_file_id=eds_id, family="my-drive")
    assert 'family = "my-drive"' in drafted["result"]["profile"]
    assert "profile.toml" in {file["name"] for file in client.get(f"/api/runs/{drafted['id']}/files").json()}
    differ = _asked(client, kind="diff", file_id=eds_id, second_file_id=eds_id)
    assert differ["result"]["diff"]["different"] == []
    assert differ["result"]["diff"]["equal"] > 10
    both = _asked(client, kind="diff", file_id=eds_id)
    assert "exactly one" in both["error"]["text"]


@pytest.mark.long
def test_many_sessions_are_estimated_anew_and_one_that_cannot_ends_nothing(client: TestClient) -> None:
    machine = client.post("/api/machines", json={"name": "m", "toml": BELIEF}).json()
    sessions = client.get("/api/results/session").json()
    assert sessions
    run = _asked(client, kind="batch", machine_id=machine["id"], jobs=1)
    assert run["state"] == "done", run["error"]
    assert len(run["result"]["batch"]["sessions"]) == len(sessions)
