"""`explain --weigh` and `--next` by HTTP: names with probabilities, in numbers and in words."""

from __future__ import annotations

from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from service_desk import ADDRESS, settings_for
from test_service_reach import _asked, _brought, _strange_csv

from schwung.cli.demo import BELIEF
from schwung.service.app import make_app
from schwung.service.guard import Guard, own_token
from schwung.service.pages.explaining import planned, told_table
from schwung.service.pages.wizard.guide import wishes_of
from schwung.service.service import Service


@pytest.mark.timeout(300)
def test_a_session_is_weighed_and_the_next_motion_asked_for(tmp_path: Path) -> None:
    with Service(settings_for(tmp_path)) as service:
        guard = Guard(service.settings, own_token(tmp_path))
        headers = {"Authorization": f"Bearer {guard.token}"}
        client = TestClient(make_app(service, guard), base_url=ADDRESS, headers=headers)
        machine = client.post("/api/machines", json={"name": "belief", "toml": BELIEF}).json()
        looked = _brought(client, "monday.csv", _strange_csv(), what="recording", guess="true")
        options = {**looked["result"]["proposals"][0]["options"], "position_unit": "deg"}
        taken = _asked(client, kind="import_as", file_id=looked["result"]["file_id"], options=options)
        request = {"session_id": taken["result"]["session_id"], "machine_id": machine["id"]}
        run = _asked(client, kind="explain", **request, weigh=True, next_motion=True)
        assert run["state"] == "done", run["error"]
        found = client.get(f"/api/explanations/{run['result']['explanation_id']}").json()
        document = found["document"]
        assert document["format"] == "schwung-explanation"
        assert document["names"] or document["unnamed"]  # the recorded machine is another one
        assert found["verdict"] in {"explained", "partly_explained", "unexplained"}
        named = {
            row[0].split("\n")[1]
            for one in document["told"]
            if one["title"] == "Names"
            for row in one["rows"]
        }
        assert named <= {one["physics"] for one in document["names"]}
        # nobody knows which motion that was: the explanation is kept, and says so
        assert document["next"]["plan"] is None
        assert document["next"]["sentence"]
        files = {file["name"] for file in client.get(f"/api/runs/{run['id']}/files").json()}
        assert files == {"explanation.json", "explanation.html", "machine.toml"} | {
            name for name in files if name.endswith(".csv")
        }


def test_tables_in_words_are_text_and_keep_their_lines() -> None:
    drawn = told_table(("physics", "probability"), [("Dry friction\ncoulomb_friction", "< 1 %")])
    assert "Dry friction<br>coulomb_friction" in drawn
    heads = told_table(("torque, RMS", "machine.toml"), [("1 N·m", "yes")])
    assert "Torque, RMS" in heads
    assert "machine.toml" in heads
    assert "&lt; 1 %" in drawn
    assert "<script>" not in told_table(("", ""), [("<script>", "<script>")])
    plan = {"distance_rad": -1.57, "duration_s": 2.0, "amplitude_nm": 14.0, "frequency_hz": 50.0, "repeats": 1,
            "phases": 1, "returns": True, "profile_kind": "third", "sample_rate_hz": 1000.0}  # fmt: skip
    typed = wishes_of(plan)  # as somebody would type it into the wizard
    assert (typed["Stroke"], typed["Time of one stroke"], typed["kind"]) == ("-1.57", "2", "third")
    assert not {"Stroke", "Time of one stroke", "Frequency", "Amplitude"} - set(typed)
    stroke = dict(planned(plan, 0.0))
    assert stroke["Injected"] == "14.0 N·m at 50.0 Hz"
