"""What has been proposed and shown, and waits to be confirmed: kept in memory, used once.

A proposal's digest is the SHA-256 of its document as JSON: who confirms it has seen that document. It is lost with
the process: after a start everything is proposed anew, with the machine as it is then.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from schwung.errors import RefusedError
from schwung.service.values import new_id

_KEPT = 64


@dataclass(frozen=True, eq=False)
class Proposal:
    """What would be done. `content` is what the work needs to do exactly this."""

    id: str
    kind: str  # of the run that would carry it out
    drive_id: str
    document: Mapping[str, Any]
    digest: str
    content: Any
    machine_id: str | None = None

    def to_json(self) -> dict[str, Any]:
        """For clients."""
        return {"proposal_id": self.id, "carries_out": self.kind, "digest": self.digest, **self.document}


class Proposals:
    """From any thread."""

    def __init__(self) -> None:
        self._held: OrderedDict[str, Proposal] = OrderedDict()
        self._lock = threading.Lock()

    def add(
        self,
        kind: str,
        drive_id: str,
        document: Mapping[str, Any],
        content: Any,
        machine_id: str | None = None,
    ) -> Proposal:
        """Keep a proposal; the oldest are forgotten."""
        text = json.dumps(document, sort_keys=True, default=str)
        digest = hashlib.sha256(text.encode()).hexdigest()
        made = Proposal(new_id(), kind, drive_id, document, digest, content, machine_id)
        with self._lock:
            self._held[made.id] = made
            while len(self._held) > _KEPT:
                self._held.popitem(last=False)
        return made

    def look(self, proposal_id: str, kind: str, digest: str) -> Proposal:
        """A proposal that is confirmed. Raises RefusedError where it is not there any more, or another one was seen."""
        held = self._held.get(proposal_id)
        if held is None or held.kind != kind:
            raise RefusedError(
                f"proposal {proposal_id}",
                "is not there: never made, used, or older than this process",
                "Propose it anew.",
            )
        if not hmac.compare_digest(held.digest, digest):
            raise RefusedError(
                f"proposal {proposal_id}", "is not what was confirmed: its digest differs", "Look again."
            )
        return held

    def take(self, proposal_id: str, kind: str, digest: str) -> Proposal:
        """As `look`, and it is used."""
        with self._lock:
            held = self.look(proposal_id, kind, digest)
            del self._held[proposal_id]
        return held
