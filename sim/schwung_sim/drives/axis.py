"""A servo axis: a plant under a drive's 8 kHz controller, in SI units; it knows nothing of any bus."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from schwung_sim.compiled import compiled_for
from schwung_sim.drives import controller as ctl
from schwung_sim.errors import BenchError
from schwung_sim.plants import Plant
from schwung_sim.plants.profile import Samples
from schwung_sim.plants.two_mass import TICK_S, TwoMassPlant

Array = NDArray[np.float64]

FEED_FORWARD_OFF, FEED_FORWARD_SCALAR, FEED_FORWARD_TABLE = 0, 1, 2
GENERATOR_OFF, GENERATOR_AT_MOTION, GENERATOR_ON = 0, 1, 2
TRACE_IDLE, TRACE_ARMED, TRACE_RUNNING, TRACE_FULL = 0, 1, 2, 3

#: How long angle and speed must stay inside their windows (s).
_SETTLED_S = 0.01


@dataclass(frozen=True)
class AxisSettings:
    """What can be set in the drive; SI. Change a running axis with `ServoAxis.configure`.

    The gains are the paper's simulation gains but for T_n: with its 8 ms the loop does not stand still where the
    inertia is highest (K_ps (K_pp + 1/T_n) > (J_r + J_l) K_pp / T_n has to hold); with 20 ms it does everywhere.
    """

    position_gain_1_s: float = 60.0
    speed_gain_nms_rad: float = 7.0
    speed_integral_time_s: float = 0.02
    speed_feed_forward: float = 1.0
    feed_forward_mode: int = FEED_FORWARD_OFF
    scalar_inertia_kgm2: float = 0.0
    rotor_inertia_kgm2: float = 0.012
    table_start_rad: float = 0.0
    table_step_rad: float = 0.05
    table_inertia_kgm2: tuple[float, ...] = ()
    torque_limit_nm: float = 233.0
    speed_filter_s: float = 100e-6
    encoder_counts: int = 2**20
    generator_amplitude_nm: float = 0.0
    generator_frequency_hz: float = 50.0
    generator_phase_rad: float = 0.0
    generator_control: int = GENERATOR_OFF
    interpolate_torque: bool = False
    standstill_speed_rad_s: float = 0.2
    target_window_rad: float = 2e-3


@dataclass(frozen=True, eq=False)
class Trace:
    """What the trace buffer holds; arrays (n,)."""

    position_counts: NDArray[np.int64]
    speed_rad_s: Array
    torque_nm: Array
    torque_added_nm: Array  # what generator and offset add from the sample's instant on
    demand_rad: Array
    sample_time_s: float


_SETTINGS = frozenset(AxisSettings.__dataclass_fields__)


def _compiled(plant: Plant) -> tuple[Callable[..., None], Any]:
    """The loop that steps a plant without leaving compiled code, and the plant as it takes it."""
    if isinstance(plant, TwoMassPlant):
        return ctl.two_mass_loop, (plant.parameters, plant.state, plant.tables)
    from schwung_sim.drives.crank_loop import crank_loop  # needs MuJoCo
    from schwung_sim.plants.slider_crank import SliderCrankPlant

    if not isinstance(plant, SliderCrankPlant):
        raise BenchError("axis", f"has no compiled loop for the plant {plant.name}")
    return crank_loop, plant.kernel


class ServoAxis:
    """Plant, encoder, filters, cascade, feed-forward, generator and trace; repeatable from `seed`."""

    def __init__(self, plant: Plant, settings: AxisSettings | None = None, seed: int = 0) -> None:
        self.plant = plant
        loop, self._machine = _compiled(plant)
        self._control = np.zeros(1, ctl.CONTROL)
        self._c: Any = self._control[0]  # a view: writes go to the array
        self._segments = np.zeros(ctl.SEGMENTS_SHAPE)
        self._history = np.zeros(ctl.HISTORY)
        self._trace = np.zeros((1, ctl.TRACE_COLUMNS))
        self._ticks = 0
        #: where in a count the axis happens to rest
        self._c["count_offset"] = np.random.default_rng([seed, 2]).uniform()
        self._c["eccentricity_rad"] = plant.sensor.eccentricity_rad
        self._c["speed_delay_ticks"] = plant.sensor.speed_delay_s / TICK_S
        self._c["rest_s"] = ctl.REST_BETWEEN_MOTIONS_S
        self._c["trace_divider"] = 1
        self.settings = settings or AxisSettings()
        self._apply(set(_SETTINGS))
        self._loop = compiled_for(loop, 1, self._control, self._memory, self._machine)
        self._follow = compiled_for(ctl.follow_setpoint, self._control, self._segments, 0.0, TICK_S)
        self._add = compiled_for(ctl.add_torque, self._control, 0.0, False)

    # Settings --------------------------------------------------------------------------------------------

    def configure(self, **changes: Any) -> None:
        """Change settings (names of AxisSettings), from the next tick on. Raises BenchError for nonsense."""
        try:
            self.settings = replace(self.settings, **changes)
        except TypeError:
            unknown = sorted(set(changes) - set(_SETTINGS))
            raise BenchError("axis", f"has no setting {', '.join(unknown)}") from None
        self._apply(set(changes))

    def _apply(self, changed: set[str]) -> None:
        """Give the controller what has changed and nothing else: it moves some values itself (generator)."""
        s, c = self.settings, self._c
        if s.encoder_counts < 1 or s.speed_filter_s < 0 or s.torque_limit_nm < 0:
            raise BenchError("axis", "encoder counts, speed filter or torque limit is negative")
        for name in changed & set(ctl.CONTROL.names or ()):
            c[name] = getattr(s, name)
        c["filter_share"] = 1.0 if s.speed_filter_s == 0 else -math.expm1(-TICK_S / s.speed_filter_s)
        if 2 * math.pi / s.encoder_counts != c["count_rad"]:
            c["count_rad"] = 2 * math.pi / s.encoder_counts
            self._read_encoder()
        points = np.array(s.table_inertia_kgm2, dtype=float)
        if points.size == 1:
            points = np.repeat(points, 2)
        usable = points.size > 0 and s.table_step_rad > 0  # an empty table is no table
        c["feed_forward_mode"] = (
            s.feed_forward_mode if usable or s.feed_forward_mode < 2 else FEED_FORWARD_OFF
        )
        values = points if points.size else np.zeros(2)
        step = s.table_step_rad if s.table_step_rad > 0 else 1.0
        self._table = Samples(values, np.gradient(values, step), s.table_start_rad, step, False)

    # Commands --------------------------------------------------------------------------------------------

    def energise(self, on: bool) -> None:
        """On: hold the present position, integrator cleared. Off: no torque, the axis coasts."""
        self._c["energised"] = int(on)
        self._c["integral_nm"] = 0.0
        self._hold(self.position_rad)

    def close_brake(self, holding_nm: float) -> None:
        """The holding brake grips the motor's shaft, and holds up to this torque; 0 opens it."""
        self._c["brake_nm"], self._c["brake_rad"] = holding_nm, self.position_rad

    def set_target(self, position_rad: float, over_s: float) -> None:
        """Cyclic setpoint: reach it after `over_s`, a cycle; speed and acceleration from the last ones.

        Within the cycle the demand is the parabola through the last setpoint and this one whose acceleration
        is the difference of the last two slopes: exact where the acceleration is constant, no later than a
        straight line. A setpoint that comes early or late changes nothing but a blend back onto this path.
        One that does not come is bridged for one cycle at constant speed; then the axis holds the last.
        """
        self._follow(self._control, self._segments, position_rad, max(over_s, TICK_S))

    def start_move(self, target_rad: float, speed: float, acceleration: float, deceleration: float) -> None:
        """Go there on a trapezoid of the drive's own (rad/s, rad/s²), from whatever the demand does now."""
        if not (speed > 0 and acceleration > 0 and deceleration > 0):
            raise BenchError("axis", "a move needs a positive speed, acceleration and deceleration")
        position, now = float(self._c["demand_rad"]), float(self._c["demand_rad_s"])
        segments: list[tuple[float, float, float, float]] = []
        stop = position + now * abs(now) / (2 * deceleration)
        if now != 0 and (target_rad - stop) * now < 0:  # it has to come back: brake first
            segments.append((abs(now) / deceleration, position, now, -math.copysign(deceleration, now)))
            position, now = stop, 0.0
        way = target_rad - position
        sign, now = math.copysign(1.0, way), abs(now)
        top = math.sqrt((2 * abs(way) + now**2 / acceleration) / (1 / acceleration + 1 / deceleration))
        peak = min(speed, top)
        rate = acceleration if peak >= now else -deceleration
        cruise = abs(way) - peak**2 / (2 * deceleration) - abs(peak**2 - now**2) / (2 * abs(rate))
        cruise_s = max(cruise, 0.0) / peak if peak > 0 else 0.0
        ramp, brake = ((peak - now) / rate, rate), (peak / deceleration, -deceleration)
        for duration, a in (ramp, (cruise_s, 0.0), brake):
            if duration > 0:
                segments.append((duration, position, sign * now, sign * a))
                position += sign * (now * duration + 0.5 * a * duration**2)
                now += a * duration
        self._plan(segments, target_rad)
        self._c["start_requested"] = 1

    def quick_stop(self, deceleration_rad_s2: float) -> None:
        """Bring the demanded speed to zero on a ramp and hold there."""
        if not deceleration_rad_s2 > 0:
            raise BenchError("axis", "a quick stop needs a positive deceleration")
        position, speed = float(self._c["demand_rad"]), float(self._c["demand_rad_s"])
        duration = abs(speed) / deceleration_rad_s2
        ramp = (duration, position, speed, -math.copysign(deceleration_rad_s2, speed))
        self._plan([ramp] if duration > 0 else [], position + 0.5 * speed * duration)

    def set_torque_offset(self, torque_nm: float) -> None:
        """Torque added to the controller's until the next one.

        It steps, as in most drives; some interpolate it over the cycle as they do with position (setting
        `interpolate_torque`). Held steps fold their images into samples of the same rate and look half a cycle late:
        whoever estimates from such samples has to know.
        """
        self._add(self._control, torque_nm, self.settings.interpolate_torque)

    def arm_trace(self, divider: int, length: int, at_once: bool = False) -> None:
        """Record every divider-th 8 kHz sample, `length` of them, from the next start of a motion on, or from now."""
        if divider < 1 or length < 1:
            raise BenchError("axis", "a trace needs a divider and a length of 1 or more")
        self._trace = np.zeros((length, ctl.TRACE_COLUMNS))
        status = TRACE_RUNNING if at_once else TRACE_ARMED
        fields = {"divider": divider, "length": length, "at": 0, "wait": 0, "status": status}
        for name, value in fields.items():
            self._c[f"trace_{name}"] = value

    def stop_trace(self) -> None:
        """Back to idle; what was recorded stays readable."""
        self._c["trace_status"] = TRACE_IDLE

    def _plan(self, segments: list[tuple[float, float, float, float]], final_rad: float) -> None:
        c = self._c
        self._segments[: len(segments)] = segments if segments else self._segments[:0]
        for name in ("segment", "segment_time_s", "extrapolate_s", "blend_rad", "cyclic"):
            c[name] = 0
        c["segments"], c["final_rad"] = len(segments), final_rad

    def _hold(self, position_rad: float) -> None:
        self._plan([], position_rad)
        ctl.update_demand_tick(self._control, self._segments)

    # Time ------------------------------------------------------------------------------------------------

    def advance(self, duration_s: float) -> None:
        """Let time pass: whole control ticks of 125 µs."""
        ticks = round(duration_s / TICK_S)
        self._ticks += ticks
        self._loop(ticks, self._control, self._memory, self._machine)
        self.plant.check()

    @property
    def _memory(self) -> Any:
        """What the loop keeps in arrays."""
        return self._segments, self._table, self._history, self._trace

    def _read_encoder(self) -> None:
        c = self._c
        angle = self.plant.motor_rad
        c["counts"] = math.floor(
            (angle + c["eccentricity_rad"] * math.sin(angle)) / c["count_rad"] + c["count_offset"]
        )
        c["position_rad"] = c["counts"] * c["count_rad"]
        self._hold(float(c["position_rad"]))

    # What the drive knows --------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Time since the axis was made."""
        return self._ticks * TICK_S

    @property
    def energised(self) -> bool:
        """The power stage is on."""
        return bool(self._c["energised"])

    @property
    def position_counts(self) -> int:
        """Encoder counts."""
        return int(self._c["counts"])

    @property
    def position_rad(self) -> float:
        """The encoder's angle."""
        return float(self._c["position_rad"])

    @property
    def speed_rad_s(self) -> float:
        """Difference of the encoder over the last tick, filtered."""
        return float(self._c["reported_speed_rad_s"])

    @property
    def torque_nm(self) -> float:
        """Torque commanded for the last tick after clipping, filtered like the speed: aligned with it."""
        return float(self._c["reported_torque_nm"])

    @property
    def torque_demand_nm(self) -> float:
        """Torque commanded for the last tick after clipping, unfiltered."""
        return float(self._c["torque_nm"])

    @property
    def demand_rad(self) -> float:
        """Demanded angle at this instant."""
        return float(self._c["demand_rad"])

    @property
    def demand_speed_rad_s(self) -> float:
        """Demanded speed at this instant."""
        return float(self._c["demand_rad_s"])

    @property
    def following_error_rad(self) -> float:
        """Demand minus encoder, of the same instant."""
        return self.demand_rad - self.position_rad

    @property
    def target_reached(self) -> bool:
        """The demand has ended and the axis has been within the window around it for 10 ms."""
        return bool(self._c["in_window_s"] >= _SETTLED_S)

    @property
    def standstill(self) -> bool:
        """The speed has been near zero for 10 ms."""
        return bool(self._c["standstill_s"] >= _SETTLED_S)

    @property
    def torque_limit_active(self) -> bool:
        """The last tick's torque was clipped."""
        return bool(self._c["limited"])

    @property
    def trace_status(self) -> Literal[0, 1, 2, 3]:
        """0 idle, 1 armed, 2 running, 3 full."""
        status: Literal[0, 1, 2, 3] = int(self._c["trace_status"])  # type: ignore[assignment]
        return status

    @property
    def trace(self) -> Trace:
        """What has been recorded so far."""
        rows = self._trace[: int(self._c["trace_at"])]
        period = int(self._c["trace_divider"]) * TICK_S
        counts, speed, torque, added, demand = rows.T.copy()
        return Trace(counts.astype(np.int64), speed, torque, added, demand, period)
