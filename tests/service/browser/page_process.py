"""A bench, the service and a browser, each a process of its own; and somebody who watches the bus."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import shutil
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can

from schwung.cli.demo import BELIEF

CHROMIUM = os.environ.get("SCHWUNG_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
#: Nothing that a browser does on its own account: only what the page asks for. What is disabled here takes the place of
#: Playwright's own list, of which the first few are; the others are pages that the browser's own window loads, unseen,
#: each time anew: more work than the page that is tested.
UNASKED = (
    "MediaRouter", "DialMediaRouteProvider", "CertificateTransparencyComponentUpdater", "Translate", "HttpsUpgrades",
    "PaintHolding", "LensOverlay", "WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "WebUIOmniboxFullPopup",
    "PreloadTopChromeWebUI",
)  # fmt: skip
ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", f"--disable-features={','.join(UNASKED)}",
]  # fmt: skip
NODE = 1
_QUICK_STOP = 0x0002
_TRIES = 4
#: What the page notes of itself, before any script of ours: when STOP was pressed (s, by the computer's clock).
PRESSES = """
window.pressed = [];
const note = (e) => window.pressed.push((performance.timeOrigin + e.timeStamp) / 1000);
window.addEventListener("pointerdown", (e) => { if (e.target.closest && e.target.closest("#stop")) note(e); }, true);
window.addEventListener("keydown", (e) => { if (e.key === "Escape") note(e); }, true);
"""


@dataclass
class BusWatch:
    """Who listens on the bench's bus: when a controlword that stops went out first, since `begin`."""

    bus: can.BusABC
    stopped_s: float | None = None
    _ended: threading.Event = field(default_factory=threading.Event)

    def begin(self) -> None:
        """Forget what was."""
        self.stopped_s = None

    def run(self) -> None:
        """Listen until `end`."""
        while not self._ended.is_set():
            message = self.bus.recv(0.2)
            if message is not None and self.stopped_s is None and is_quick_stop(message):
                self.stopped_s = time.time()

    def end(self) -> None:
        """Listen no more."""
        self._ended.set()


def is_quick_stop(message: can.Message) -> bool:
    """Whether a frame tells the drive to stop: controlword 0x0002, by RPDO 1 or by SDO (CiA 301, CiA 402)."""
    data = bytes(message.data)
    if message.arbitration_id == 0x200 + NODE:
        return int.from_bytes(data[:2], "little") == _QUICK_STOP
    return message.arbitration_id == 0x600 + NODE and data[:6] == bytes((0x2B, 0x40, 0x60, 0, _QUICK_STOP, 0))


@dataclass
class Served:
    """A running service, and its drive."""

    url: str
    token: str
    drive_id: str
    watch: BusWatch
    put_back: set[str] = field(default_factory=set)  # exports

    def call(self, method: str, path: str, body: Any = None) -> Any:
        """One call of the API."""
        data = None if body is None else json.dumps(body).encode()
        headers = {
            "Authorization": f"Bearer {self.token}",
            "Content-Type": "application/json",
            "Schwung-Who": "tests",
        }
        request = urllib.request.Request(self.url + path, data, headers, method=method)
        with urllib.request.urlopen(request, timeout=30) as answer:
            content = answer.read()
        return json.loads(content) if content else None

    def with_its_drive(self) -> None:
        """The bench's drive alone, as it was at first but for its history."""
        for drive in self.call("GET", "/api/drives"):
            self.call("DELETE", f"/api/drives/{drive['id']}")
        machine = self.call("GET", "/api/machines")[0]
        drive = {"name": "Test axis", "bus": "bus", "node_id": NODE, "machine_id": machine["id"]}
        self.drive_id = self.call("POST", "/api/drives", drive)["id"]

    def ended(self, run_id: str, within_s: float = 60.0) -> Any:
        """A run, when it has ended."""
        end = time.monotonic() + within_s
        while (run := self.call("GET", f"/api/runs/{run_id}"))["state"] in ("queued", "running"):
            assert time.monotonic() < end, run
            time.sleep(0.05)
        return run

    def settle(self) -> None:
        """Nothing goes on, nothing is stopped, and the drive is as it was: one that feeds forward plays no other's."""
        runs = self.call("GET", "/api/runs?limit=10")
        for run in runs:
            if run["state"] in ("queued", "running"):
                with contextlib.suppress(urllib.error.HTTPError):  # it has ended meanwhile
                    self.call("POST", f"/api/runs/{run['id']}/cancel")
                self.ended(run["id"])
        if self.call("GET", "/api/stop")["stopped"]:
            self.call("POST", "/api/release")
        for run in runs:
            if run["kind"] == "export" and run["state"] == "done" and run["id"] not in self.put_back:
                self._put_back(run)

    def _put_back(self, export: Any) -> None:
        files = self.call("GET", f"/api/runs/{export['id']}/files")
        backup = next(file["id"] for file in files if file["name"] == "export.backup.json")
        asked = {"kind": "propose_restore", "drive_id": export["drive_id"], "file_id": backup}
        shown = self.ended(self.call("POST", "/api/runs", asked)["id"])["result"]
        confirmed = {"kind": "restore", "proposal_id": shown["proposal_id"], "digest": shown["digest"]}
        assert self.ended(self.call("POST", "/api/runs", confirmed)["id"])["state"] == "done"
        self.put_back.add(export["id"])

    def commissioned(self) -> str:
        """A commissioning that came to its end: its run."""
        for run in self.call("GET", "/api/runs?limit=100"):
            if (run["kind"], run["state"]) == ("commission", "done"):
                return str(run["id"])
        run = self.ended(self._confirmed(1)["id"], within_s=90.0)
        assert run["state"] == "done", run
        return str(run["id"])

    def begin_motion(self, repeats: int = 50) -> Any:
        """A long commissioning, when it moves; the run.

        A computer that is too busy to send its heartbeat in time is stopped by the drive; that is begun anew.
        """
        for _ in range(_TRIES):
            run = self._begun(repeats)
            if run["state"] == "running":
                return run
            assert run["error"]["type"] in ("DriveFaultError", "NodeLostError"), run
            self.ended(
                self.call("POST", "/api/runs", {"kind": "reset_fault", "drive_id": self.drive_id})["id"]
            )
        raise AssertionError(run)

    def _confirmed(self, repeats: int) -> Any:
        for distance_rad in (3.14, -3.14):  # earlier stops have left it somewhere
            stroke = {"distance_rad": distance_rad, "duration_s": 0.25, "repeats": repeats}
            plan = {"kind": "plan", "drive_id": self.drive_id, **stroke}
            made = self.ended(self.call("POST", "/api/runs", plan)["id"])
            assert made["state"] == "done", made
            if made["result"]["can_start"]:
                break
        confirmed = {key: made["result"][key] for key in ("proposal_id", "digest")}
        return self.call("POST", "/api/runs", {"kind": "commission", **confirmed})

    def _begun(self, repeats: int) -> Any:
        run = self._confirmed(repeats)
        end = time.monotonic() + 60.0
        while run["state"] in ("queued", "running"):
            assert time.monotonic() < end, run
            if ((run["progress"] or {}).get("phase") or "").startswith(("Creep", "Motion")):
                break
            time.sleep(0.02)
            run = self.call("GET", f"/api/runs/{run['id']}")
        return run


@contextmanager
def serving(folder: Path, plant: str = "slider-crank") -> Iterator[Served]:
    """Within: a bench and a service on it, with one drive and its machine, on ports that the system chose."""
    with _process("bench", "--tcp", "127.0.0.1:0", "--plant", plant, "-n", str(NODE)) as bench:
        assert bench.stdout is not None
        line = bench.stdout.readline()
        found = re.search(r"channel=(\S+) host=(\S+) port=(\d+)", line)
        assert found, line
        place = {"channel": found[1], "host": found[2], "port": int(found[3])}
        arguments = (
            "-i", "socketcand", "-c", found[1], "--bus", f"host={found[2]}", "--bus", f"port={found[3]}", "--port", "0",
            "--data", str(folder), "--json", "--poll", "0.3",
        )  # fmt: skip
        with _process("serve", *arguments) as service:
            assert service.stdout is not None
            started = _json_of(service.stdout)
            logging.getLogger("can.interfaces.socketcand").setLevel(logging.ERROR)  # a word per torn packet
            watch = BusWatch(can.Bus(interface="socketcand", **place))
            thread = threading.Thread(target=watch.run, daemon=True)
            thread.start()
            try:
                served = Served(started["url"], started["token"], "", watch)
                served.call("POST", "/api/machines", {"name": "Slider-crank", "toml": BELIEF})
                served.with_its_drive()
                yield served
            finally:
                watch.end()
                thread.join(5)
                watch.bus.shutdown()


@contextmanager
def _process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "schwung", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(10)
        assert process.stdout is not None
        process.stdout.close()


def _json_of(lines: Any) -> dict[str, Any]:
    """The first JSON document of an output that goes on."""
    text = ""
    for line in lines:
        text += line
        try:
            return dict(json.loads(text))
        except ValueError:
            continue
    raise AssertionError(text)


@contextmanager
def browser_process() -> Iterator[Any]:
    """Within: a browser."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415  # only where there is a browser

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def visiting(browser: Any, served: Served, *, logged_in: bool = True, **context: Any) -> Iterator[Any]:
    """Within: a page of somebody new; `page.asked` has every address that it asked for, `page.troubles` its errors."""
    visitor = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **context})
    page = visitor.new_page()
    page.set_default_timeout(60_000)
    page.add_init_script(PRESSES)
    page.asked, page.troubles = [], []
    page.on("request", lambda request: page.asked.append(request.url))
    page.on("websocket", lambda socket: page.asked.append(socket.url))
    page.on("pageerror", lambda error: page.troubles.append(str(error)))
    page.on("console", lambda said: page.troubles.append(said.text) if said.type == "error" else None)
    if logged_in:
        page.goto(f"{served.url}/login?token={served.token}&who=Page%20Tester")
    try:
        yield page
    finally:
        visitor.close()
