"""Network management: commands, our heartbeat, and an eye on the node's."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import can

from schwung.errors import BusError, DriveError, DriveFaultError, NodeLostError
from schwung.fieldbus.canopen.emcy import Emergency
from schwung.fieldbus.canopen.link import Link

MASTER_NODE_ID = 0x7F  # whose heartbeat the drive listens for
NMT_STATES = {0x00: "INITIALISING", 0x04: "STOPPED", 0x05: "OPERATIONAL", 0x7F: "PRE-OPERATIONAL"}
START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
MISSES_ALLOWED = 3  # heartbeats that may be missing before a node counts as lost, on both sides

UNKNOWN = "UNKNOWN"


def send_command(link: Link, command: int, node_id: int) -> None:
    """Send an NMT command to one node. Raises BusError."""
    link.send(0x000, bytes([command, node_id]))


class NodeMonitor:
    """What one node tells of itself: NMT state, restarts, emergencies. Calls `on_trouble` once armed."""

    def __init__(self, link: Link, node_id: int) -> None:
        self.node_id = node_id
        self.nmt = UNKNOWN
        self.boot_ups = 0
        self.emergencies: list[Emergency] = []
        self.on_trouble: Callable[[DriveError], None] | None = None
        self._link = link
        self._heard = threading.Event()
        self._last_heard = 0.0
        self._expected_within_s: float | None = None
        link.subscribe(0x700 + node_id, self._on_heartbeat)
        link.subscribe(0x080 + node_id, self._on_emergency)

    def close(self) -> None:
        """Stop listening."""
        self.on_trouble = None
        self._link.unsubscribe(0x700 + self.node_id, self._on_heartbeat)
        self._link.unsubscribe(0x080 + self.node_id, self._on_emergency)

    def expect(self, heartbeat_s: float | None) -> None:
        """From now on a heartbeat is due at least every `heartbeat_s` times MISSES_ALLOWED, and shall show OPERATIONAL.

        None: not watched.
        """
        self._last_heard = time.monotonic()
        self._expected_within_s = None if heartbeat_s is None else MISSES_ALLOWED * heartbeat_s

    def check(self, late_s: float = 0.0) -> None:
        """Report a node that fell silent. `late_s`: by how much the caller itself was late, which excuses the node."""
        within = self._expected_within_s
        if within is None:
            return
        silent = time.monotonic() - self._last_heard - late_s
        if silent > within:
            self._expected_within_s = None
            self._trouble(NodeLostError(
                f"node {self.node_id}", f"no heartbeat for {silent:.2f} s", "Check its power and cable."))  # fmt: skip

    def wait_for(self, state: str, timeout_s: float) -> bool:
        """Wait until a heartbeat shows the NMT state."""
        deadline = time.monotonic() + timeout_s
        while self.nmt != state:
            left = deadline - time.monotonic()
            if left <= 0:
                return False
            self._heard.clear()
            self._heard.wait(min(left, 0.05))
        return True

    def last_emergency(self, since_s: float) -> Emergency | None:
        """The latest emergency not older than `since_s` (receive time), error resets left out."""
        found = [e for e in self.emergencies if e.time_s >= since_s and not e.is_reset]
        return found[-1] if found else None

    def _on_heartbeat(self, message: can.Message) -> None:
        state = message.data[0] & 0x7F if message.data else 0
        self._last_heard = time.monotonic()
        self.nmt = NMT_STATES.get(state, f"state 0x{state:02X}")
        if state == 0x00:
            self.boot_ups += 1
            self._trouble(NodeLostError(
                f"node {self.node_id}", "restarted on its own (boot-up message)", "Check its supply."))  # fmt: skip
        elif state != 0x05 and self._expected_within_s is not None:
            self._trouble(NodeLostError(
                f"node {self.node_id}", f"left OPERATIONAL for {self.nmt}",
                "It missed our heartbeat, or another master sent an NMT command."))  # fmt: skip
        self._heard.set()

    def _on_emergency(self, message: can.Message) -> None:
        emergency = Emergency.decode(bytes(message.data), time.time())
        self.emergencies.append(emergency)
        del self.emergencies[:-100]
        if not emergency.is_reset:
            self._trouble(DriveFaultError(
                f"node {self.node_id}", f"emergency {emergency}", "Remove its cause, then reset it."))  # fmt: skip

    def _trouble(self, error: DriveError) -> None:
        if self.on_trouble is not None:
            self.on_trouble(error)


class HeartbeatProducer:
    """Our heartbeat from a thread of its own, so that the drive notices when we die; also looks after `monitor`."""

    def __init__(self, link: Link, monitor: NodeMonitor, period_s: float) -> None:
        self.period_s = period_s
        self._link, self._monitor = link, monitor
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="schwung heartbeat", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Fall silent."""
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(2 * self.period_s + 0.5)

    def _run(self) -> None:
        data = bytes([0x05])
        due = time.monotonic()
        while not self._ending.is_set():
            try:
                self._link.send(0x700 + MASTER_NODE_ID, data)
            except BusError as error:
                if self._monitor.on_trouble is not None:
                    self._monitor.on_trouble(error)
            due += self.period_s
            self._ending.wait(max(0.0, due - time.monotonic()))
            late = max(0.0, time.monotonic() - due)
            self._monitor.check(late)
            if late > self.period_s:
                due = time.monotonic()
