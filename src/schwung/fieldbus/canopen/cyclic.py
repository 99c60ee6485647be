"""The cyclic exchange with one drive while it runs: frames out, answers in, and what they say in counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schwung.errors import BusError, StateError
from schwung.fieldbus.canopen import following
from schwung.fieldbus.canopen.exchange import Exchange, Producer
from schwung.fieldbus.canopen.kernel import KernelProducer
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.output import Output, StopFrame
from schwung.fieldbus.canopen.pdo import Layouts
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.canopen.sync import LockstepProducer, PeriodicProducer
from schwung.fieldbus.drive import Acquisition, SyncChoice
from schwung.fieldbus.profile import CanopenProfile

_ANSWERS_WITHIN_S = 1.0


class Cyclic:
    """From `start` to `stop`; `answering` says whether what the PDOs tell is fresh."""

    def __init__(
        self,
        link: Link,
        profile: CanopenProfile,
        layouts: Layouts,
        acquisition: Acquisition,
        sdo: SdoChannel,
        sync: SyncChoice,
        *,
        counter: bool,
    ) -> None:
        self.acquisition, self.answering = acquisition, False
        self.started_s = link.clock.date()
        producer = chosen(sync, link, profile, sdo)
        self.exchange = Exchange(link, layouts, sdo.node_id, counter)
        self._layouts, self._profile = layouts, profile
        self._place = f"node {sdo.node_id}"
        carriers = (i for i, t in enumerate(layouts.tpdos) if t.carries(profile.quantities.position.object))
        self._position_tpdo = next(carriers, None)  # none: a drive that can only be looked at
        self._watched: following.Following | None = None  # the last playback, which knows what is usual
        self.producer = self._producer(producer)

    def _producer(self, choice: SyncChoice) -> Producer:
        exchange, period_s = self.exchange, 1.0 / self.acquisition.sample_rate_hz
        stop_frame = StopFrame.of(self._profile, self._layouts.rpdo)
        if choice == "kernel":
            kernel = KernelProducer(exchange, period_s, stop_frame)
            exchange.latch = kernel.latch_ring
            return kernel
        output = Output(exchange.link.clock, stop_frame, self._place)
        exchange.latch = output.latch
        kind = LockstepProducer if choice == "lockstep" else PeriodicProducer
        return kind(exchange, period_s, output)

    @property
    def mode(self) -> int:
        """The mode of operation that was asked for, as the drive numbers it."""
        return self._profile.modes[self.acquisition.mode]

    def start(self, frame: bytes) -> None:
        """Begin, holding a frame, and wait for the first answers. Raises StateError where a TPDO does not come."""
        exchange, clock = self.exchange, self.exchange.link.clock
        self.producer.start(frame)
        end = clock.now() + _ANSWERS_WITHIN_S
        while any(latest is None for latest in exchange.latest):
            if isinstance(exchange.trouble, BusError):
                raise exchange.trouble
            if clock.now() > end:
                pairs = zip(self._layouts.tpdos, exchange.latest, strict=True)
                silent = ", ".join(str(tpdo.pdo.number) for tpdo, latest in pairs if latest is None)
                raise StateError(
                    self._place, f"TPDO {silent} does not answer SYNC", "Is it mapped and enabled?"
                )
            self.pump(0.01)

    def stop(self) -> None:
        """End SYNC and PDOs."""
        self.producer.stop()
        self.exchange.close()

    def pump(self, duration_s: float) -> bool:
        """Let so much of the drive's time pass; False where it does not answer."""
        self.answering = self.producer.pump(duration_s)
        return self.answering

    def await_answers(self) -> bool:
        """Until the drive has shown anew where it is: what is decided right then is decided by no older sight, and goes
        out with the next SYNC, not with the one after. False where it does not answer."""
        self.answering = self.producer.await_answers()
        return self.answering

    def frame(self, controlword: int, target: int) -> bytes:
        """An RPDO frame that holds a target (counts), without injected torque."""
        columns: dict[str, int] = {
            "6040:00": controlword,
            str(self._profile.quantities.position.demand): target,
        }
        if self._layouts.rpdo.carries("6060:00"):
            columns["6060:00"] = self.mode
        return self._layouts.rpdo.pack(columns, 1)

    @property
    def target(self) -> int | None:
        """The target (counts) of the frame that went out last; None before the first."""
        last = self.producer.last
        if not last:
            return None
        return int(self._layouts.rpdo.unpack([last])[str(self._profile.quantities.position.demand)][0])

    def watch(self, demand_counts: NDArray[np.int64], tolerated: float | None, patience_s: float) -> None:
        """Watch, in cyclic position, that the axis is where these setpoints (n,) send it, and that none of them is a
        leap; see Following. Not where nobody has said how much is tolerated, or the position is no signed integer."""
        exchange, number = self.exchange, self._position_tpdo
        if number is None or tolerated is None or self.acquisition.mode != "csp":
            return
        position, layout = str(self._profile.quantities.position.object), self._layouts.tpdos[number]
        if layout.dtype[position].kind != "i":
            return
        rate_hz = self.acquisition.sample_rate_hz
        lag = self._watched.lag_cycles if self._watched is not None else None
        watch = following.Following(layout, position, demand_counts, rate_hz, tolerated, patience_s, lag)
        self._watched, answers = watch, exchange.answer_counts

        def look(frame: bytes | bytearray) -> None:
            recorder = exchange.recorder
            if recorder is None or not recorder.setpoints:
                return
            if watch.away(recorder.setpoints[-1], frame, exchange.sync_count - answers[number]):
                exchange.report(following.trouble(exchange.node_id))

        exchange.watchers, exchange.leaps = {number: look}, watch.leaps

    def unwatch(self) -> None:
        """End `watch`."""
        self.exchange.watchers, self.exchange.leaps = {}, None

    @property
    def statusword(self) -> int | None:
        """As the PDOs tell it; None where they are not answered."""
        return self.exchange.statusword if self.answering else None

    @property
    def position(self) -> int | None:
        """Position (counts) as the PDOs tell it; None where they do not."""
        number = self._position_tpdo
        frame = self.exchange.latest[number] if self.answering and number is not None else None
        if frame is None or number is None:
            return None
        layout = self._layouts.tpdos[number]
        return int(layout.unpack([frame])[str(self._profile.quantities.position.object)][0])


def chosen(sync: SyncChoice, link: Link, profile: CanopenProfile, sdo: SdoChannel) -> SyncChoice:
    """What "auto" means for a bus and a drive. Raises StateError for lockstep with a drive that has its own time."""
    clock = profile.sync.clocked_by_sync
    clocked = clock is not None and sdo.read_integer(clock.index, clock.subindex, "UNSIGNED8") == 1
    if sync == "lockstep" and not clocked:
        place = f"node {sdo.node_id}"
        raise StateError(place, "lockstep needs a drive whose time is SYNC", 'Use sync="auto".')
    if sync != "auto":
        return sync
    if link.clock.simulated:  # it keeps every deadline, and waits for none
        return "thread"
    if clocked:
        return "lockstep"
    return "kernel" if type(link.bus).__name__ == "SocketcanBus" else "thread"
