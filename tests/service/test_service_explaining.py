"""`explain` and `--next` by HTTP: names with probabilities, in numbers and in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from service_desk import ADDRESS, settings_for
from test_service_reach import _asked, _brought

import schwung
from schwung.drivetrain import Load, simulate, write_machine
from schwung.service.app import make_app
from schwung.service.guard import Guard, own_token
from schwung.service.pages.explaining import planned, told_table
from schwung.service.pages.wizard.guide import wishes_of
from schwung.service.service import Service

REST_S, STROKE_S, RATE_HZ = 0.3, 0.4, 1000.0
BELIEVED_KGM2 = 0.1  # of 0.11


def _recording() -> bytes:
    """Degrees and N·m under names that say nothing, as finely as a drive tells them, at rest before and after."""
    time = np.arange(round((2 * REST_S + STROKE_S) * RATE_HZ) + 1) / RATE_HZ
    motion = schwung.Motion(kind="poly5", distance_rad=3.0, duration_s=STROKE_S)
    demand = motion.demand(np.clip(time - REST_S, 0.0, STROKE_S))
    made = simulate(schwung.example_machine(control=True), demand, time)
    rows = np.column_stack([time, np.degrees(made.position_rad), made.torque_nm])
    return "\n".join(["a,b,c", *(f"{t:.3f},{angle:.2f},{torque:.1f}" for t, angle, torque in rows)]).encode()


@pytest.mark.long
@pytest.mark.timeout(300)
def test_a_session_is_weighed_and_the_next_motion_asked_for(tmp_path: Path) -> None:
    with Service(settings_for(tmp_path)) as service:
        guard = Guard(service.settings, own_token(tmp_path))
        headers = {"Authorization": f"Bearer {guard.token}"}
        client = TestClient(make_app(service, guard), base_url=ADDRESS, headers=headers)
        believed = schwung.example_machine(control=True)
        lighter = believed.model_copy(update={"load": Load(inertia_kgm2=BELIEVED_KGM2)})
        write_machine(lighter, tmp_path / "belief.toml")
        toml = (tmp_path / "belief.toml").read_text("utf-8")
        machine = client.post("/api/machines", json={"name": "belief", "toml": toml}).json()
        looked = _brought(client, "monday.csv", _recording(), what="recording", guess="true")
        options = {**looked["result"]["proposals"][0]["options"], "position_unit": "deg"}
        taken = _asked(client, kind="import_as", file_id=looked["result"]["file_id"], options=options)
        request = {"session_id": taken["result"]["session_id"], "machine_id": machine["id"]}
        run = _asked(client, kind="explain", **request, next_motion=True)
        assert run["state"] == "done", run["error"]
        found = client.get(f"/api/explanations/{run['result']['explanation_id']}").json()
        document = found["document"]
        assert document["format"] == "schwung-explanation"
        assert "load_inertia" in {one["physics"] for one in document["names"]}
        assert found["verdict"] == "partly_explained"  # of one run nothing can be kept aside to prove it
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
