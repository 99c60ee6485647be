"""Moving one drive: cyclic exchange from start to stop, state transitions, playback, and stopping on trouble."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterator
from typing import Literal

from schwung.errors import (
    BusError,
    DriveError,
    NodeLostError,
    StateError,
)
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import diagnosis, nmt, playback
from schwung.fieldbus.canopen.emcy import describe_code
from schwung.fieldbus.canopen.exchange import Exchange, Producer
from schwung.fieldbus.canopen.kernel import KernelProducer
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.own_means import Lookup, OwnMeans
from schwung.fieldbus.canopen.pdo import Layouts
from schwung.fieldbus.canopen.recorder import Recorder
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.canopen.setup import temporarily
from schwung.fieldbus.canopen.sync import LockstepProducer, ThreadProducer
from schwung.fieldbus.cia402 import State
from schwung.fieldbus.drive import (
    Acquisition,
    Parameter,
    ParameterValue,
    Progress,
    Recording,
    Setpoints,
    attach_recording,
)
from schwung.fieldbus.profile import CanopenProfile
from schwung.fieldbus.units import Scales

SyncChoice = Literal["auto", "lockstep", "kernel", "thread"]

START_WINDOW_RAD = 0.02  # how far the first setpoint may be from where the axis stands
_TRANSITION_S = 2.0  # a state that lasts longer than this is stuck
_STANDSTILL_S = 2.0
_STILL_STEP_S, _STILL_RAD = 0.005, 2e-4  # slower than 0.04 rad/s for three steps is standstill
_NMT_S = 1.0
_CONTROLWORD = Parameter(0x6040, 0, "UNSIGNED16", "Controlword")
_OFF = (State.SWITCH_ON_DISABLED, State.NOT_READY, State.FAULT)


class Operation:
    """The part of the driver that moves the machine; the driver says what is set up and in which units."""

    def __init__(
        self,
        link: Link,
        sdo: SdoChannel,
        monitor: nmt.NodeMonitor,
        profile: CanopenProfile,
        layouts: Layouts,
        sync: SyncChoice,
        lookup: Lookup,
        *,
        counter: bool,
    ) -> None:
        self._link, self._sdo, self._monitor, self._profile = link, sdo, monitor, profile
        self._layouts, self._sync, self._counter = layouts, sync, counter
        self._exchange: Exchange | None = None
        self._producer: Producer | None = None
        self._acquisition: Acquisition | None = None
        self._scales: Scales | None = None
        self._window_rad = START_WINDOW_RAD
        self._target = 0  # counts
        self._started_s = 0.0
        self._answering = False  # PDOs are: what they say is fresh
        self._halting = threading.RLock()
        self._own, self._lookup = OwnMeans(sdo, profile, lookup), lookup
        q = profile.quantities
        self._demand_name = str(q.position.demand)
        carriers = (i for i, t in enumerate(layouts.tpdos) if t.carries(q.position.object))
        self._position_tpdo = next(carriers, None)  # none: a drive that can only be looked at
        self._place = f"node {sdo.node_id}"

    @property
    def running(self) -> bool:
        """True between start and stop."""
        return self._producer is not None

    @property
    def own_means(self) -> OwnMeans:
        """The drive's generator and trace."""
        return self._own

    @property
    def producer_name(self) -> str:
        """Who produces SYNC: "lockstep", "kernel" or "thread"; as chosen where it does not run yet."""
        return self._producer.name if self._producer is not None else self._sync

    @property
    def _mode(self) -> int | None:
        return None if self._acquisition is None else self._profile.modes[self._acquisition.mode]

    @contextlib.contextmanager
    def pre_operational(self) -> Iterator[None]:
        """Node pre-operational within; operational again afterwards where it was."""
        was_operational = self._monitor.nmt == "OPERATIONAL"
        self._to_pre_operational()
        yield
        if was_operational:
            nmt.send_command(self._link, nmt.START, self._sdo.node_id)

    def start(self, acquisition: Acquisition, scales: Scales, following_window_rad: float | None) -> None:
        """Node operational, PDOs running, power stage off. Raises StateError, NodeLostError."""
        if self._producer is not None:
            raise StateError(self._place, "already exchanges PDOs", "Stop it first.")
        state = cia402.decode(self._statusword())
        if state in cia402.ENERGISED:
            raise StateError(
                self._place,
                f'is in "{state.value}": somebody else has switched it on',
                "Switch it off there.",
            )
        self._acquisition, self._scales, self._started_s = acquisition, scales, time.time()
        self._window_rad = min(START_WINDOW_RAD, (following_window_rad or math.inf) / 2)
        exchange = self._exchange = Exchange(self._link, self._layouts, self._sdo.node_id, self._counter)
        self._monitor.on_trouble = exchange.report
        self._link.on_failure = exchange.report
        try:
            nmt.send_command(self._link, nmt.START, self._sdo.node_id)
            if not self._monitor.wait_for("OPERATIONAL", _NMT_S + acquisition.heartbeat_s):
                raise NodeLostError(
                    self._place, "does not become operational", "Does its heartbeat (1017) come?"
                )
            self._monitor.expect(acquisition.heartbeat_s)
            self._target = self._position_by_sdo()
            self._producer = self._choose(exchange, 1.0 / acquisition.sample_rate_hz)
            self._producer.start(self._frame(cia402.DISABLE_VOLTAGE))
            self._await_answers(exchange)
        except BaseException:
            self.stop()
            raise

    def enable(self) -> None:
        """Walk to Operation enabled, holding the present position. Raises StateError, DriveFaultError."""
        _, _, acquisition, _ = self._running()
        self._walk(State.OPERATION_ENABLED)
        wanted = self._profile.modes[acquisition.mode]
        shown = self._sdo.read_integer(0x6061, 0, "INTEGER8")
        if shown is not None and shown != wanted:
            self.halt()
            raise StateError(
                self._place, f"mode {wanted} was asked for, the drive shows {shown} (6061)", "Look at 6502."
            )

    def play(self, setpoints: Setpoints, progress: Progress | None) -> Recording:
        """Play and record; see CanopenDrive.play."""
        exchange, producer, acquisition, scales = self._running()
        if exchange.trouble is not None:
            self.halt()
            raise diagnosis.explain(self._sdo, self._monitor, self._started_s, exchange.trouble)
        playable = playback.pack(
            setpoints, acquisition.mode, self._profile, self._layouts.rpdo, scales, self._target
        )
        self._await_standstill()
        self._check_start(setpoints, acquisition, scales)
        pp = acquisition.mode == "pp"
        if acquisition.sampling == "trace" and not pp:
            self._rest_at(int(playable.position_counts[0]), producer)
        recorder = Recorder(len(self._layouts.tpdos))
        strokes = playback.dynamics(setpoints.moves, scales, self._lookup) if pp else []
        own = self._own.around(setpoints, acquisition, playable, scales)
        with temporarily(self._sdo, strokes + own.settings), own.acting():
            error = self._run(exchange, producer, playable, recorder, progress)
        recording = playback.build(
            recorder, playable, self._profile, self._layouts, scales, producer.name, acquisition.sample_rate_hz,
            setpoints.position_rad if pp else None,
        )  # fmt: skip
        self._target = int(playable.position_counts[max(recorder.played - 1, 0)])
        refused = playback.unacknowledged(recording, setpoints.moves) if pp and error is None else None
        if refused is not None:
            self.halt()
            error = StateError(
                self._place,
                f"did not take the move at sample {refused.at_index}",
                "Look at 6081 to 6084 and 607D.",
            )
        recording, error = own.recorded(recording, error, self._pump)
        if error is None:
            return recording
        if isinstance(error, DriveError):
            error = diagnosis.explain(self._sdo, self._monitor, self._started_s, error)
        attach_recording(error, recording)
        raise error

    def halt(self) -> None:
        """Quick stop by RPDO and SDO. Never raises."""
        if not self._halting.acquire(timeout=1.0):
            return  # another thread has been at it for a second already
        try:
            exchange, producer = self._exchange, self._producer
            if exchange is not None:  # also while it is being enabled: nothing goes on from here but off
                exchange.guarded = False
                exchange.report(StateError(self._place, "was stopped on request (halt)", "Start it anew."))
            if producer is not None:
                with contextlib.suppress(Exception):
                    producer.hold(self._frame(cia402.QUICK_STOP))
            heard = self._sdo.write_once(_CONTROLWORD, cia402.QUICK_STOP, lock_timeout_s=0.2, timeout_s=0.2)
            self._own.kill()
            if producer is not None:
                with contextlib.suppress(Exception):
                    if not self._await_standstill() and not heard and not self._answering:
                        self._sdo.assume_silent()
        finally:
            self._halting.release()

    def reset_fault(self) -> None:
        """Fault reset, then Switch on disabled and nothing more."""
        for word in (cia402.DISABLE_VOLTAGE, cia402.FAULT_RESET, cia402.DISABLE_VOLTAGE):
            self._command(word)
        if self._exchange is not None:
            self._exchange.clear()
        deadline = time.monotonic() + _TRANSITION_S
        while cia402.decode(self._statusword()) in (State.FAULT, State.FAULT_REACTION):
            if time.monotonic() > deadline:
                code = self._sdo.read_integer(0x603F, 0, "UNSIGNED16") or 0
                raise StateError(
                    self._place, f"the fault cannot be reset, its cause is still there ({describe_code(code)})",
                    "Remove the cause.",
                )  # fmt: skip
            self._pump(0.01)

    def disable(self) -> None:
        """Standstill, then power stage off. Raises StateError."""
        self._pump(0.0)
        state = cia402.decode(self._statusword())
        if state is State.FAULT_REACTION:
            self._pump(0.5)
            return
        if state in _OFF:
            return
        if state is State.OPERATION_ENABLED:
            if self._producer is not None and not self._await_standstill():
                self.halt()
            for word in (cia402.SWITCH_ON, cia402.SHUTDOWN):
                self._command(word)
        self._walk(State.SWITCH_ON_DISABLED)

    def stop(self) -> None:
        """End SYNC and PDOs, node pre-operational."""
        producer, exchange = self._producer, self._exchange
        self._producer = self._exchange = None
        self._answering = False
        self._monitor.on_trouble = self._link.on_failure = None
        if producer is not None:
            producer.stop()
        if exchange is not None:
            exchange.close()
            self._monitor.expect(None)
            self._to_pre_operational()

    def close(self) -> None:
        """Stop whatever still runs; never raises."""
        if self._producer is not None:
            with contextlib.suppress(Exception):
                if cia402.decode(self._statusword()) is State.OPERATION_ENABLED:
                    self.halt()
                self.disable()
            with contextlib.suppress(Exception):
                self.stop()

    # ── within ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _run(
        self,
        exchange: Exchange,
        producer: Producer,
        playable: playback.Playable,
        recorder: Recorder,
        progress: Progress | None,
    ) -> BaseException | None:
        """Play with the guard up. Trouble, Ctrl-C and defects stop the drive while it is still being recorded."""
        exchange.recorder = recorder
        exchange.guarded = True
        stopped: BaseException | None = None
        try:
            producer.play(playable.frames, playable.after, recorder, progress)
        except BaseException as error:
            stopped = error
        exchange.guarded = False
        stopped = stopped or exchange.trouble
        if stopped is not None:
            self.halt()
        exchange.recorder = None
        return stopped

    def _running(self) -> tuple[Exchange, Producer, Acquisition, Scales]:
        parts = (self._exchange, self._producer, self._acquisition, self._scales)
        exchange, producer, acquisition, scales = parts
        if exchange is None or producer is None or acquisition is None or scales is None:
            raise StateError(self._place, "does not exchange PDOs", "Call start first.")
        return exchange, producer, acquisition, scales

    def _choose(self, exchange: Exchange, period_s: float) -> Producer:
        clock = self._profile.sync.clocked_by_sync
        clocked = clock is not None and self._sdo.read_integer(clock.index, clock.subindex, "UNSIGNED8") == 1
        choice = self._sync
        if choice == "auto":
            on_socketcan = type(self._link.bus).__name__ == "SocketcanBus"
            choice = "lockstep" if clocked else "kernel" if on_socketcan else "thread"
        if choice == "lockstep":
            if not clocked:
                raise StateError(self._place, "lockstep needs a drive whose time is SYNC", 'Use sync="auto".')
            return LockstepProducer(exchange, period_s)
        return (
            KernelProducer(exchange, period_s) if choice == "kernel" else ThreadProducer(exchange, period_s)
        )

    def _await_answers(self, exchange: Exchange) -> None:
        deadline = time.monotonic() + _NMT_S
        while any(frame is None for frame in exchange.latest):
            if exchange.trouble is not None and isinstance(exchange.trouble, BusError):
                raise exchange.trouble
            if time.monotonic() > deadline:
                silent = [
                    t.pdo.number
                    for t, f in zip(self._layouts.tpdos, exchange.latest, strict=True)
                    if f is None
                ]
                raise StateError(
                    self._place,
                    f"TPDO {', '.join(map(str, silent))} does not answer SYNC",
                    "Is it mapped and enabled?",
                )
            self._pump(0.01)

    def _walk(self, wanted: State) -> None:
        """Step towards a state. Raises StateError or DriveFaultError naming what is missing."""
        previous, since, word = None, time.monotonic(), cia402.DISABLE_VOLTAGE
        while True:
            status = self._statusword()
            state = cia402.decode(status)
            trouble = self._exchange.trouble if self._exchange is not None else None
            # Switching off goes on whatever comes.
            if trouble is not None and wanted is State.OPERATION_ENABLED:
                self.halt()
                raise diagnosis.explain(self._sdo, self._monitor, self._started_s, trouble)
            if state is wanted:
                return
            if state is not previous:
                previous, since = state, time.monotonic()
            step = cia402.next_controlword(state, wanted)
            if step is None or time.monotonic() - since > _TRANSITION_S:
                raise diagnosis.why_stuck(self._sdo, self._monitor, status, word, wanted, self._mode)
            word = step
            if state is not State.OPERATION_ENABLED:
                self._target = self._position()
            self._command(word)

    def _check_start(self, setpoints: Setpoints, acquisition: Acquisition, scales: Scales) -> None:
        status = self._statusword()
        if cia402.decode(status) is not State.OPERATION_ENABLED:
            raise StateError(
                self._place, f'is in "{cia402.decode(status).value}"', "Enable it before playing."
            )
        if abs(setpoints.sample_rate_hz - acquisition.sample_rate_hz) > 1e-6 * acquisition.sample_rate_hz:
            raise StateError(
                self._place,
                f"was started for {acquisition.sample_rate_hz:g} Hz",
                "Start it for the setpoints' rate.",
            )
        stands = self._position() * scales.position_rad
        off = float(setpoints.position_rad[0]) - stands
        if abs(off) > self._window_rad:
            raise StateError(
                self._place,
                f"stands at {stands:.4f} rad, the first setpoint is {off:+.4f} rad away (of {self._window_rad:.4f})",
                "Start the motion where the axis stands.",
            )

    def _frame(self, controlword: int) -> bytes:
        columns: dict[str, int] = {"6040:00": controlword, self._demand_name: self._target}
        if self._acquisition is not None and self._layouts.rpdo.carries("6060:00"):
            columns["6060:00"] = self._profile.modes[self._acquisition.mode]
        return self._layouts.rpdo.pack(columns, 1)

    def _command(self, controlword: int) -> None:
        """Send a controlword, by SDO where PDOs are not answered, and give the drive time for it."""
        if self._producer is not None:
            self._producer.hold(self._frame(controlword))
        if not self._answering:
            self._sdo.write(ParameterValue(_CONTROLWORD, controlword))
        self._pump(0.005)

    def _pump(self, duration_s: float) -> bool:
        if self._producer is not None:
            self._answering = self._producer.pump(duration_s)
        else:
            self._answering = False
            time.sleep(duration_s)
        return self._answering

    def _statusword(self) -> int:
        by_pdo = self._exchange.statusword if self._exchange is not None and self._answering else None
        if by_pdo is not None:
            return by_pdo
        return self._sdo.read_integer(0x6041, 0, "UNSIGNED16") or 0

    def _position(self) -> int:
        exchange, number = self._exchange if self._answering else None, self._position_tpdo
        frame = exchange.latest[number] if exchange is not None and number is not None else None
        if frame is None or number is None:
            return self._position_by_sdo()
        layout = self._layouts.tpdos[number]
        return int(layout.unpack([frame])[str(self._profile.quantities.position.object)][0])

    def _position_by_sdo(self) -> int:
        ref = self._profile.quantities.position.object
        return self._sdo.read_integer(ref.index, ref.subindex, "INTEGER32") or 0

    def _rest_at(self, target: int, producer: Producer) -> None:
        """Hold the first setpoint before a trace is armed: a step of some counts towards it would start the trace."""
        self._target = target
        producer.hold(self._frame(cia402.ENABLE_OPERATION))
        self._pump(0.2)  # longer than what a drive takes for the rest before a new motion

    def _await_standstill(self) -> bool:
        """Let time pass until the position hardly changes; False after two seconds of the drive's time or silence."""
        if not self._pump(0.0):
            return False
        tolerance = _STILL_RAD / abs(self._scales.position_rad) if self._scales is not None else 0.0
        elapsed, still, last = 0.0, 0, self._position()
        while elapsed < _STANDSTILL_S and still < 3:
            if not self._pump(_STILL_STEP_S):
                return False
            elapsed += _STILL_STEP_S
            now = self._position()
            still = still + 1 if abs(now - last) <= tolerance else 0
            last = now
        return still >= 3

    def _to_pre_operational(self) -> None:
        with contextlib.suppress(BusError):
            nmt.send_command(self._link, nmt.PRE_OPERATIONAL, self._sdo.node_id)
            if self._monitor.nmt != nmt.UNKNOWN:
                self._monitor.wait_for("PRE-OPERATIONAL", 0.5)
            else:
                time.sleep(0.02)
