"""Moving one drive: start, enable, play, stop. How it comes to rest is in stopping.py."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from schwung.errors import BusError, DriveError, EnergisedError, NodeLostError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import diagnosis, nmt, playback
from schwung.fieldbus.canopen.cyclic import Cyclic, chosen
from schwung.fieldbus.canopen.dialogue import Dialogue
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.live import LiveTap
from schwung.fieldbus.canopen.own_means import Around, Lookup, OwnMeans
from schwung.fieldbus.canopen.pdo import Layouts
from schwung.fieldbus.canopen.recorder import Recorder
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.canopen.setup import temporarily
from schwung.fieldbus.canopen.stopping import Stopping
from schwung.fieldbus.canopen.sync import measure_evenness
from schwung.fieldbus.cia402 import State
from schwung.fieldbus.drive import (
    Acquisition,
    DriveLimits,
    Progress,
    Recording,
    Setpoints,
    SyncChoice,
    SyncTiming,
    attach_recording,
)
from schwung.fieldbus.profile import CanopenProfile
from schwung.fieldbus.units import Scales
from schwung.fieldbus.walker import PATIENCE_S

START_WINDOW_RAD = 0.02  # how far the first setpoint may be from where the axis stands
APPROACH_S = (
    0.2  # over which the rest of that way is gone: longer than the rest that a drive wants between motions
)
_NMT_S = 1.0


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
        read_scales: Callable[[], Scales],
        *,
        counter: bool,
    ) -> None:
        self.own_means = OwnMeans(sdo, profile, lookup)  # the drive's generator and trace
        self._link, self._clock, self._sdo = link, link.clock, sdo
        self._monitor, self._profile = monitor, profile
        self._layouts, self._sync, self._counter, self._lookup = layouts, sync, counter, lookup
        self.live = LiveTap(profile, layouts, read_scales)
        self._dialogue = Dialogue(sdo, monitor, profile)
        self._place = self._dialogue.place
        self._scales: Scales | None = None
        self._window_rad = START_WINDOW_RAD
        #: Following error that is tolerated, and for how long (counts, s).
        self._tolerated: tuple[float | None, float] = (None, 0.0)
        self._stopping = Stopping(
            link, sdo, monitor, self._dialogue, self.own_means, lambda: read_scales().position_rad
        )

    @property
    def running(self) -> bool:
        """True between start and stop."""
        return self._dialogue.cyclic is not None

    @property
    def producer_name(self) -> str:
        """Who produces SYNC: "lockstep", "kernel" or "thread"; as chosen where it does not run yet."""
        cyclic = self._dialogue.cyclic
        return self._sync if cyclic is None else cyclic.producer.name

    def measure_sync(self, sample_rate_hz: float) -> SyncTiming | None:
        """See Drive.measure_sync."""
        if self._clock.simulated or chosen(self._sync, self._link, self._profile, self._sdo) != "thread":
            return None
        return measure_evenness(self._link, 1.0 / sample_rate_hz)

    @contextlib.contextmanager
    def pre_operational(self) -> Iterator[None]:
        """Node pre-operational within; operational again afterwards where it was."""
        was_operational = self._monitor.nmt == "OPERATIONAL"
        self._to_pre_operational()
        yield
        if was_operational:
            nmt.send_command(self._link, nmt.START, self._sdo.node_id)

    def start(self, acquisition: Acquisition, scales: Scales, limits: DriveLimits) -> None:
        """Node operational, PDOs running, power stage off. Raises StateError, NodeLostError; EnergisedError, and
        nothing is sent that would change its state."""
        if self.running:
            raise StateError(self._place, "already exchanges PDOs", "Stop it first.")
        self._stopping.require_not_halted()
        self._dialogue.walker.require_off()
        if self._dialogue.state() is State.UNKNOWN:
            raise StateError(
                self._place, "shows no state that CiA 402 knows", "Is this the profile of this drive?"
            )
        self._scales = scales
        self._stopping.begin(scales.position_rad, limits)
        off_rad = limits.following_error_rad or None
        self._window_rad = min(START_WINDOW_RAD, (off_rad or math.inf) / 2)
        off_counts = off_rad / abs(scales.position_rad) if off_rad else None
        patiences = [limits.following_error_time_s]
        if acquisition.guard is not None:
            patiences.append(acquisition.guard.following_error_time_s)
        self._tolerated = (off_counts, min((one for one in patiences if one is not None), default=0.0))
        cyclic = Cyclic(
            self._link,
            self._profile,
            self._layouts,
            acquisition,
            self._sdo,
            self._sync,
            counter=self._counter,
        )
        self._monitor.on_trouble = self._link.on_failure = cyclic.exchange.report
        try:
            nmt.send_command(self._link, nmt.START, self._sdo.node_id)
            if not self._monitor.wait_for("OPERATIONAL", _NMT_S + acquisition.heartbeat_s):
                raise NodeLostError(
                    self._place, "does not become operational", "Does its heartbeat (1017) come?"
                )
            self._dialogue.walker.require_off()  # the first frame would take its voltage away
            self._monitor.expect(acquisition.silence_allowed_s)
            here = self._dialogue.position()
            self._dialogue.cyclic = cyclic
            cyclic.start(cyclic.frame(cia402.DISABLE_VOLTAGE, here))
            self._stopping.require_not_halted()
        except EnergisedError:
            cyclic.stop()  # nothing has been sent
            self.stop()
            raise
        except BaseException:
            self._dialogue.cyclic = cyclic
            self.stop()
            raise

    def enable(self) -> None:
        """Walk to Operation enabled, holding the present position. Raises StateError, DriveFaultError."""
        cyclic, _ = self._running()

        wrong_mode: StateError | None = None

        def ready() -> None:  # looked at right before it is energised, however long it takes to get there
            nonlocal wrong_mode
            self._require_untroubled()
            try:
                self._require_mode(cyclic)
            except StateError as error:
                wrong_mode = error
                raise
            cyclic.await_answers()  # the axis may have been turned while the mode was asked for

        walker = self._dialogue.walker
        walker.climb(State.SWITCHED_ON, self._require_untroubled)
        try:
            walker.climb(State.OPERATION_ENABLED, ready, sent=cia402.SWITCH_ON)
        except StateError as error:
            if error is not wrong_mode:
                self._require_untroubled()  # a stop came after the last look: what it was for
            raise

    def play(self, setpoints: Setpoints, progress: Progress | None) -> Recording:
        """Play and record; see CanopenDrive.play."""
        cyclic, scales = self._running()
        acquisition = cyclic.acquisition
        self._require_untroubled()
        playable = playback.pack(
            setpoints, acquisition.mode, self._profile, self._layouts.rpdo, scales, self._target(cyclic)
        )
        self._stopping.stands(until=self._stopping.troubled)
        self._require_untroubled()
        self._check_start(setpoints, acquisition, scales)
        self._stopping.fastest_rad_s = max(self._stopping.fastest_rad_s, playback.fastest_rad_s(setpoints))
        pp = acquisition.mode == "pp"
        strokes = playback.dynamics(setpoints.moves, scales, self._lookup) if pp else []
        own = self.own_means.around(setpoints, acquisition, playable, scales)
        if not pp:
            self._approach(cyclic, int(playable.position_counts[0]), armed=acquisition.sampling == "trace")
        with temporarily(self._sdo, strokes + own.settings):
            try:
                return self._motion(cyclic, setpoints, playable, own, progress)
            except BaseException:
                if not self._stopping.stopped:
                    self._stopping.quick_stop()
                raise

    def _motion(
        self, cyclic: Cyclic, setpoints: Setpoints, playable: playback.Playable, own: Around,
        progress: Progress | None,
    ) -> Recording:  # fmt: skip
        """Trouble of whatever kind leaves it to the caller to stop the drive, where that has not been done."""
        acquisition, pp = cyclic.acquisition, cyclic.acquisition.mode == "pp"
        recorder = Recorder(len(self._layouts.tpdos))
        self.live.begin(recorder, playable, acquisition.sample_rate_hz)
        with own.acting(self._require_untroubled):
            error = self._run(
                cyclic, playable.frames, playable.after, recorder, playable.position_counts, progress
            )
        recording = playback.build(
            recorder, playable, self._profile, self._layouts, own.scales, cyclic.producer.name,
            acquisition.sample_rate_hz, setpoints.position_rad if pp else None,
        )  # fmt: skip
        self._link.traffic.motion(
            recorder.sync_times, recording.timing.period_s, recording.position_rad.size, recording.lost.size
        )
        refused = playback.unacknowledged(recording, setpoints.moves) if pp and error is None else None
        if refused is not None:
            self._stopping.quick_stop()
            error = StateError(
                self._place,
                f"did not take the move at sample {refused.at_index}",
                "Look at 6081 to 6084 and 607D.",
            )
        recording, error = own.recorded(recording, error, cyclic.pump)
        if error is None:
            return recording
        if isinstance(error, DriveError):
            error = self._explained(cyclic, error)
        attach_recording(error, recording)
        raise error

    def halt(self) -> None:
        """See Stopping.halt."""
        self._stopping.halt()

    def reset_fault(self) -> None:
        """See Stopping.reset_fault."""
        self._stopping.reset_fault()

    def disable(self) -> None:
        """See Stopping.disable."""
        self._stopping.disable()

    def stop(self) -> None:
        """End SYNC and PDOs, node pre-operational."""
        cyclic, self._dialogue.cyclic = self._dialogue.cyclic, None
        self._monitor.on_trouble = self._link.on_failure = None
        if cyclic is not None:
            cyclic.stop()
            self._monitor.expect(None)
            self._to_pre_operational()

    def close(self) -> None:
        """Stop whatever still runs; never raises."""
        if self.running:
            with contextlib.suppress(Exception):  # what cannot be looked at is stopped by `disable`
                if self._dialogue.state() in (State.OPERATION_ENABLED, State.UNKNOWN):
                    self._stopping.quick_stop()
            for step in (self.disable, self.stop):
                with contextlib.suppress(Exception):
                    step()

    # ── within ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _run(
        self, cyclic: Cyclic, frames: list[bytes], after: bytes, recorder: Recorder, counts: NDArray[np.int64],
        progress: Progress | None,
    ) -> BaseException | None:  # fmt: skip
        """Play with the guard up. Trouble, Ctrl-C and defects stop the drive while it is still being recorded."""
        exchange = cyclic.exchange
        exchange.recorder = recorder
        cyclic.watch(counts, *self._tolerated)
        exchange.guard(follows=cyclic.acquisition.mode == "csp")
        self._stopping.moved = True
        stopped: BaseException | None = None
        try:
            cyclic.producer.play(frames, after, recorder, progress)
        except BaseException as error:
            stopped = error
        exchange.guarded = False
        cyclic.unwatch()
        if stopped is None or isinstance(stopped, DriveError):  # then what came first counts
            stopped = exchange.trouble or stopped
        if stopped is not None:
            self._stopping.quick_stop()
        exchange.recorder = None
        return stopped

    def _running(self) -> tuple[Cyclic, Scales]:
        cyclic, scales = self._dialogue.cyclic, self._scales
        if cyclic is None or scales is None:
            raise StateError(self._place, "does not exchange PDOs", "Call start first.")
        return cyclic, scales

    def _require_untroubled(self) -> None:
        """Stop, and raise what has come up since `start`, a halt among it."""
        cyclic, _ = self._running()
        if cyclic.exchange.trouble is not None:
            self._stopping.quick_stop()
            raise self._explained(cyclic, cyclic.exchange.trouble)

    def _explained(self, cyclic: Cyclic, trouble: DriveError) -> DriveError:
        return diagnosis.explain(self._sdo, self._monitor, cyclic.started_s, trouble)

    def _require_mode(self, cyclic: Cyclic) -> None:
        """Raise StateError where the drive shows another mode than the one asked for, before it is energised.

        One whose object dictionary has 6061 must show it: refusing to is no sign of the right mode.
        """
        shown, silent = None, self._lookup(0x6061, 0) is None

        def agrees() -> bool:
            nonlocal shown
            cyclic.pump(0.005)
            shown = self._sdo.read_integer(0x6061, 0, "INTEGER8")
            return shown == cyclic.mode or (silent and shown is None)

        if not self._clock.wait(agrees, PATIENCE_S):
            self._stopping.quick_stop()
            raise StateError(
                self._place,
                f"mode {cyclic.mode} was asked for, the drive shows {'none' if shown is None else shown} (6061)",
                "Look at 6502.",
            )

    def _check_start(self, setpoints: Setpoints, acquisition: Acquisition, scales: Scales) -> None:
        state = self._dialogue.state()
        if state is not State.OPERATION_ENABLED:
            raise StateError(
                self._place,
                f'is in "{state.value}"',
                "Enable it before playing; if it was and fell back, look for an enable input or STO.",
            )
        if abs(setpoints.sample_rate_hz - acquisition.sample_rate_hz) > 1e-6 * acquisition.sample_rate_hz:
            raise StateError(
                self._place,
                f"was started for {acquisition.sample_rate_hz:g} Hz",
                "Start it for the setpoints' rate.",
            )
        stands = self._dialogue.position() * scales.position_rad
        off = float(setpoints.position_rad[0]) - stands
        if abs(off) > self._window_rad:
            raise StateError(
                self._place,
                f"stands at {stands:.4f} rad, the first setpoint is {off:+.4f} rad away (of {self._window_rad:.4f})",
                "Start the motion where the axis stands.",
            )

    def _target(self, cyclic: Cyclic) -> int:
        return self._dialogue.position() if cyclic.target is None else cyclic.target

    def _approach(self, cyclic: Cyclic, first: int, *, armed: bool) -> None:
        """Go to the first setpoint from the one that holds: in one SYNC that would be a step, which also would start
        a trace that is `armed` for the motion; such a one is given its rest."""
        begin = self._target(cyclic)
        if begin != first:
            count = max(2, round(APPROACH_S * cyclic.acquisition.sample_rate_hz))
            share = (1 - np.cos(np.pi * np.arange(1, count + 1) / count)) / 2
            way = np.rint(begin + share * (first - begin)).astype(np.int64)
            frames = [cyclic.frame(cia402.ENABLE_OPERATION, int(counts)) for counts in way]
            error = self._run(cyclic, frames, frames[-1], Recorder(len(self._layouts.tpdos)), way, None)
            if error is not None:
                raise self._explained(cyclic, error) if isinstance(error, DriveError) else error
        if armed:
            cyclic.pump(APPROACH_S)

    def _to_pre_operational(self) -> None:
        with contextlib.suppress(BusError):
            nmt.send_command(self._link, nmt.PRE_OPERATIONAL, self._sdo.node_id)
            if self._monitor.nmt != nmt.UNKNOWN:
                self._monitor.wait_for("PRE-OPERATIONAL", 0.5)
            else:
                self._clock.sleep(0.02)
