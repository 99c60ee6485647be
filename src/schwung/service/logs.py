"""What happens, one JSON object per line: for journald, Loki, or whoever collects logs.

    {"time": "…", "level": "info", "logger": "schwung.service", "event": "run ended", "who": "…", "drive": "…",
     "job": "…", "kind": "commission", "state": "done"}

`event` is a short text that stays the same, what differs stands in fields of its own. A library's line has its text as
`event`; an exception has `error` and `trace`.
"""

from __future__ import annotations

import json
import logging
import sys
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from typing import IO, Any

from schwung.service.latch import Stopped
from schwung.service.values import ENDED, RunView

_log = logging.getLogger("schwung.service.events")
#: Attributes of a record whose values are fields of the line; put there by `extra=`.
FIELDS = ("who", "drive", "job", "kind", "state", "detail")


class JsonFormatter(logging.Formatter):
    """A record as one line of JSON."""

    def format(self, record: logging.LogRecord) -> str:
        """See logging.Formatter."""
        line: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "event": record.getMessage(),
        }
        line |= {name: value for name in FIELDS if (value := getattr(record, name, None)) is not None}
        if record.exc_info and record.exc_info[0] is not None:
            line["error"] = f"{record.exc_info[0].__name__}: {record.exc_info[1]}"
            line["trace"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False, default=str)


def log_json(stream: IO[str] | None = None) -> None:
    """From now on the log goes to `stream` (None: stderr), one JSON object per line: ours all, others' warnings."""
    handler = logging.StreamHandler(stream or sys.stderr)
    handler.setFormatter(JsonFormatter())
    logging.getLogger().addHandler(handler)
    logging.getLogger("schwung").setLevel(logging.INFO)


class EventLog:
    """Logs what a service tells its listeners: each run when its state changes, STOP and its release."""

    def __init__(self, drive_name: Callable[[str], str]) -> None:
        self._drive_name = drive_name
        self._states: dict[str, str] = {}
        self._lock = threading.Lock()

    def __call__(self, change: object) -> None:
        """See Service.subscribe."""
        if isinstance(change, RunView):
            self._run(change)
        elif isinstance(change, Stopped):
            _log.warning("stop", extra={"who": change.who})
        elif change is None:
            _log.warning("stop released")

    def _run(self, run: RunView) -> None:
        with self._lock:
            if self._states.get(run.id) == run.state:
                return
            self._states[run.id] = run.state
            if run.state in ENDED:
                del self._states[run.id]
        level = logging.WARNING if run.state in ("failed", "interrupted") else logging.INFO
        drive = None if run.drive_id is None else self._drive_name(run.drive_id)
        detail = (run.error or {}).get("text")
        more = {
            "who": run.who,
            "drive": drive,
            "job": run.id,
            "kind": run.kind,
            "state": run.state,
            "detail": detail,
        }
        _log.log(level, "run ended" if run.state in ENDED else f"run {run.state}", extra=more)
