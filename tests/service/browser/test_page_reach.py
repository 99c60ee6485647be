"""What the page reaches besides the wizard, clicked through: scan and add, files, columns, configuration, profiles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_process import NODE, Served

import schwung

sync_api = pytest.importorskip("playwright.sync_api")
ENABLED = ":not([aria-disabled])"
EDS = Path(__file__).parents[3] / "device_profiles" / "schwung-bench" / "schwung-bench.eds"


def _recording(path: Path) -> Path:
    """A stroke there, back, and there again: degrees and N·m under names that say nothing."""
    machine = schwung.example_machine(control=True)
    made = schwung.simulate(machine, schwung.Motion(kind="poly5", distance_rad=3.0, duration_s=0.4))
    rest = np.zeros(300)
    position = np.concatenate([rest, np.degrees(made.position_rad), rest + np.degrees(made.position_rad[-1])])
    torque = np.concatenate([rest, made.torque_nm, rest])
    position, torque = (np.concatenate([one, one[::-1], one]) for one in (position, torque))
    rows = np.column_stack([np.arange(position.size) / 1000.0, position, torque])
    path.write_text(
        "a,b,c\n" + "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows), encoding="utf-8"
    )
    return path


def _submit(page: Any, what: str, files: dict[str, Path], form: int = 0) -> None:
    """Fill in an upload form and send it."""
    place = page.locator("form.sw-upload").nth(form)
    if what:
        place.locator("select[name=what]").select_option(what)
    for name, path in files.items():
        place.locator(f"input[name={name}]").set_input_files(str(path))
    place.locator("button").click()


@pytest.mark.long
@pytest.mark.timeout(240)
def test_a_drive_is_found_added_changed_and_taken_away(page: Any, served: Served) -> None:
    served.call("DELETE", f"/api/drives/{served.drive_id}")
    try:
        page.goto(f"{served.url}/")
        page.get_by_role("link", name="Add a drive").click()
        page.get_by_label("To node").fill("3")
        page.click(f"button:has-text('Scan the bus'){ENABLED}")
        page.click(f"button:has-text('Take node {NODE}')")
        sync_api.expect(page.get_by_label("Name", exact=True)).to_have_value("Schwung bench drive")
        page.click("button:has-text('Add the drive')")
        page.get_by_role("heading", name="This drive", exact=True).wait_for()
        page.get_by_label("Name", exact=True).fill("Pusher <3>")
        page.click("button:has-text('Keep the changes')")
        page.get_by_role("heading", name="Pusher <3>").wait_for()
        page.get_by_label("Name", exact=True).fill("")
        page.click("button:has-text('Keep the changes')")
        page.get_by_text("Name: is missing").wait_for()  # a sentence, and nothing is changed
        page.click("button:has-text('Close')")
        page.click("button:has-text('Take it from the list')")
        page.get_by_text("No drive yet").wait_for()
    finally:
        served.with_its_drive()


@pytest.mark.long
@pytest.mark.timeout(240)
def test_a_file_is_brought_guessed_confirmed_and_a_wrong_one_is_a_sentence(
    page: Any, served: Served, tmp_path: Path
) -> None:
    page.goto(f"{served.url}/files")
    _submit(page, "recording", {"file": _recording(tmp_path / "monday.csv")})
    page.get_by_text("Confirm, or put right").wait_for()
    assert (
        page.locator(".sw-picture img").evaluate("image => image.decode().then(() => image.naturalWidth)")
        > 500
    )
    page.click("button:has-text('Take it in')")
    page.get_by_text("confirmation: is missing").wait_for()  # what is not sure wants a mark
    page.click("button:has-text('Close')")
    for mark in page.get_by_role("checkbox").all():
        mark.click()
    page.click("button:has-text('Take it in')")
    page.get_by_role("heading", name="Import with confirmed columns").wait_for()
    page.get_by_text("What may follow").wait_for()
    page.go_back()  # and forth: nothing is asked for twice
    page.get_by_text("Confirm, or put right").wait_for()

    wrong = tmp_path / "holiday.csv"
    wrong.write_bytes(b"\xff\xd8\xff\xe0 no recording at all\n")
    page.goto(f"{served.url}/files")
    _submit(page, "recording", {"file": wrong})
    page.locator(".sw-problem").wait_for()
    assert page.locator(".sw-problem").count() == 1
    page.get_by_text("name the columns that you know").wait_for()  # the way on
    page.goto(f"{served.url}/files")
    page.locator("form.sw-upload").first.locator("select[name=what]").select_option("session")
    wrong = tmp_path / "program.exe"
    wrong.write_bytes(b"MZ")
    _submit(page, "session", {"file": wrong})
    page.get_by_text("Send one of: .h5").wait_for()
    page.troubles.clear()  # the browser has told of the 422


@pytest.mark.long
@pytest.mark.timeout(240)
def test_configurations_and_profiles(page: Any, served: Served) -> None:
    page.goto(f"{served.url}/drive/{served.drive_id}")
    page.click(f"button:has-text('Back up its parameters'){ENABLED}")
    page.click(f"button:has-text('Show what differs from drive.dcf'){ENABLED}")
    page.get_by_text("Nothing: what both have is equal.").wait_for()
    page.goto(f"{served.url}/drive/{served.drive_id}")
    _submit(page, "", {"file": EDS})
    page.click(f"button:has-text('Show what differs from drive.eds'){ENABLED}")
    page.get_by_text(" are equal").wait_for()  # of the result: the button, too, speaks of what differs
    page.goto(f"{served.url}/files")
    _submit(page, "", {"file": EDS}, form=1)
    page.get_by_role("heading", name="Import", exact=True).wait_for()
    _ends(page)
    page.goto(f"{served.url}/files")
    page.click(f"button:has-text('Draft a profile from it'){ENABLED}")
    page.get_by_text("profile.toml, as drafted").wait_for()
    page.goto(f"{served.url}/drive/{served.drive_id}")
    page.click(f"button:has-text('Plan the frequency response'){ENABLED}")
    page.get_by_text("Carry it out").wait_for(timeout=90_000)
    assert page.locator(f"button:has-text('Move the machine'){ENABLED}").count() == 0  # nobody has confirmed
    assert page.troubles == []


@pytest.mark.long
@pytest.mark.timeout(240)
def test_a_frequency_response_and_the_best_motion_are_confirmed_and_made(page: Any, served: Served) -> None:
    here = {"drive_id": served.drive_id}
    still = {
        "kind": "propose_bode",
        "angles_rad": [0.2],
        "repeats": 1,
        "periods": 2,
        "sample_rate_hz": 500.0,
        **here,
    }
    _carry_out(page, served, still)
    page.locator(".sw-figure svg").first.wait_for()  # what was measured, and what was fitted
    machine = served.call("GET", "/api/machines")[-1]["id"]
    stroke = {"distance_rad": 1.0, "duration_s": 0.4}
    _carry_out(
        page,
        served,
        {"kind": "propose_play", "machine_id": machine, "repeats": 1, "rivals": False, **stroke, **here},
    )
    page.get_by_text("Motions beside each other").wait_for()
    assert page.troubles == []


def _carry_out(page: Any, served: Served, asked: dict[str, Any]) -> None:
    """Have something proposed, look at it, tick every mark, press the button, and see it done."""
    made = served.ended(served.call("POST", "/api/runs", asked)["id"], within_s=120.0)
    assert made["state"] == "done", made["error"]
    page.goto(f"{served.url}/run/{made['id']}")
    page.get_by_label("Your name").fill("Ada")
    for mark in page.get_by_role("checkbox").all():
        mark.click()
    page.click(f"button:has-text('Move the machine'){ENABLED}")
    page.wait_for_url(lambda url: not url.endswith(made["id"]))
    run = served.ended(page.url.rpartition("/")[2], within_s=120.0)
    assert (run["state"], run["who"]) == ("done", "Ada"), run["error"]
    _ends(page)


def _ends(page: Any) -> None:
    """The page of a run goes to what came of it when the run ends; whoever leaves before would be fetched back."""
    page.get_by_text("All as one archive (zip)").wait_for()
