"""Network management: commands, our heartbeat, and an eye on the node's."""

from __future__ import annotations

from collections.abc import Callable

import can

from schwung.errors import BusError, DriveError, DriveFaultError, NodeLostError, StateError
from schwung.fieldbus.canopen.emcy import Emergency
from schwung.fieldbus.canopen.link import Link

MASTER_NODE_ID = 0x7F  # whose heartbeat the drive listens for
NMT_STATES = {0x00: "INITIALISING", 0x04: "STOPPED", 0x05: "OPERATIONAL", 0x7F: "PRE-OPERATIONAL"}
START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
MASTER_HEARTBEAT_ID = 0x700 + MASTER_NODE_ID
BEATS_PER_LIMIT = 3  # ours, within the time after which a drive that listens gives us up
MISSES_ALLOWED = (
    3  # heartbeats that may be missing before a node counts as lost, on both sides, where nobody says
)

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
        self._link, self.clock = link, link.clock
        self._last_heard = 0.0
        self._expected_within_s: float | None = None
        link.subscribe(0x700 + node_id, self._on_heartbeat)
        link.subscribe(0x080 + node_id, self._on_emergency)

    def close(self) -> None:
        """Stop listening."""
        self.on_trouble = None
        self._link.unsubscribe(0x700 + self.node_id, self._on_heartbeat)
        self._link.unsubscribe(0x080 + self.node_id, self._on_emergency)

    def expect(self, within_s: float | None) -> None:
        """From now on a heartbeat is due within so long, and shall show OPERATIONAL. None: not watched."""
        self._last_heard = self.clock.now()
        self._expected_within_s = within_s

    def check(self, late_s: float = 0.0) -> None:
        """Report a node that fell silent. `late_s`: by how much the caller itself was late, which excuses the node."""
        within = self._expected_within_s
        if within is None:
            return
        silent = self.clock.now() - self._last_heard - late_s
        if silent > within:
            self._expected_within_s = None
            self._trouble(NodeLostError(
                f"node {self.node_id}", f"no heartbeat for {silent:.2f} s", "Check its power and cable."))  # fmt: skip

    def wait_for(self, state: str, timeout_s: float) -> bool:
        """Wait until a heartbeat shows the NMT state."""
        return self.clock.wait(lambda: self.nmt == state, timeout_s)

    def last_emergency(self, since_s: float) -> Emergency | None:
        """The latest emergency not older than `since_s` (receive time), error resets left out."""
        found = [e for e in self.emergencies if e.time_s >= since_s and not e.is_reset]
        return found[-1] if found else None

    def _on_heartbeat(self, message: can.Message) -> None:
        state = message.data[0] & 0x7F if message.data else 0
        self._last_heard = self.clock.now()
        self.nmt = NMT_STATES.get(state, f"state 0x{state:02X}")
        if state == 0x00:
            self.boot_ups += 1
            self._trouble(NodeLostError(
                f"node {self.node_id}", "restarted on its own (boot-up message)", "Check its supply."))  # fmt: skip
        elif state != 0x05 and self._expected_within_s is not None:
            self._trouble(NodeLostError(
                f"node {self.node_id}", f"left OPERATIONAL for {self.nmt}",
                "It missed our heartbeat, or another master sent an NMT command."))  # fmt: skip

    def _on_emergency(self, message: can.Message) -> None:
        emergency = Emergency.decode(bytes(message.data), self.clock.date())
        self.emergencies.append(emergency)
        del self.emergencies[:-100]
        if not emergency.is_reset:
            self._trouble(DriveFaultError(
                f"node {self.node_id}", f"emergency {emergency}", "Remove its cause, then reset it."))  # fmt: skip

    def _trouble(self, error: DriveError) -> None:
        if self.on_trouble is not None:
            self.on_trouble(error)


class HeartbeatProducer:
    """Our heartbeat, so that the drive notices when we die; also looks after `monitor`.

    Raises StateError where another master beats as the same node: if one died, the drive would run on by the other's.
    """

    def __init__(self, link: Link, monitor: NodeMonitor, masters: OtherMasters, period_s: float) -> None:
        self.period_s = period_s
        masters.require_none()
        self._link, self._monitor, self._clock = link, monitor, link.clock
        masters.on_heard = self._report
        self._due = self._clock.now()
        self._task = self._clock.every(period_s, self._beat, "schwung heartbeat")

    def close(self) -> None:
        """Fall silent."""
        self._task.close()

    def _beat(self) -> None:
        late = max(0.0, self._clock.now() - self._due)
        self._due += self.period_s + (late if late > self.period_s else 0.0)
        try:
            self._link.send(MASTER_HEARTBEAT_ID, bytes([0x05]))
        except BusError as error:
            self._report(error)
        self._monitor.check(late)

    def _report(self, error: DriveError) -> None:
        if self._monitor.on_trouble is not None:
            self._monitor.on_trouble(error)


class OtherMasters:
    """Listens for heartbeats of our own node id: a drive watches the id, not who sends it, so nobody else may."""

    LISTEN_S = 1.0  # before our first heartbeat: most masters beat more often

    def __init__(self, link: Link) -> None:
        self.on_heard: Callable[[DriveError], None] | None = None
        self._link, self._clock, self._heard = link, link.clock, False
        self._since = self._clock.now()
        link.subscribe(MASTER_HEARTBEAT_ID, self._on_heartbeat)

    def require_none(self) -> None:
        """Listen for LISTEN_S since the connection was made. Raises StateError where somebody was heard."""
        self._clock.wait(lambda: self._heard, self._since + self.LISTEN_S - self._clock.now())
        if self._heard:
            raise self._error()

    def close(self) -> None:
        """Stop listening."""
        self._link.unsubscribe(MASTER_HEARTBEAT_ID, self._on_heartbeat)

    def _on_heartbeat(self, message: can.Message) -> None:
        self._heard = True
        if self.on_heard is not None:
            self.on_heard(self._error())

    def _error(self) -> StateError:
        return StateError(
            self._link.name,
            f"another master sends heartbeats as node {MASTER_NODE_ID}, too: the drive would not notice if we died",
            "Disconnect it, or stop its program, while commissioning.",
        )
