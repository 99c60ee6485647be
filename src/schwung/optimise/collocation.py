"""The problem as a nonlinear programme: one interval as a CasADi function, mapped over the grid, solved by IPOPT.

Betts, Practical Methods for Optimal Control, 2nd ed., ch. 4 (direct collocation); Radau's points: Hairer and
Wanner, Solving Ordinary Differential Equations II, IV.5. Unknown are the motor's share of the stroke and its two
derivatives at the nodes, and wind-up and its rate of every load at the nodes and Radau's points (decision 13).

Time runs from 0 to 1, angles in shares of the distance, torques in shares of the limit, wind-up in what that torque
winds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from schwung.motion import Array
from schwung.optimise.inverse import Instant, Scales, instant, motor_within, resting_twist
from schwung.optimise.model import Model
from schwung.optimise.values import MotionLimits, Task

#: The peak torque that is minimised may pass the limit by this share: an interior-point method wants an interior where
#: the time is the shortest that there is.
TOP_ROOM = 1e-3

#: What copper weighs beside a peak.
TIES = 1e-3

ca.GlobalOptions.setNumpyMode(1)  # numpy's functions on symbols give symbols, as the model needs

#: Radau's points of the third degree, in shares of an interval; the last is the node that follows.
DEGREE = 3
#: Nodes per period of the fastest swing of motor against load, and how many there are at the least and as a rule at the
#: most; a stroke of many periods gets as many as show the swing at all.
NODES_PER_PERIOD, FEWEST, MOST = 5.0, 160, 240
SHOWN_BY, MOST_OF_ALL = 2.5, 800


def nodes_for(models: Sequence[Model], duration_s: float, distance_rad: float) -> int:
    """Intervals of the grid: enough for what swings fastest, and for cogging."""
    periods = duration_s * max(map(swings_at_hz, models))
    for _, order, _ in models[0].effects.cogging_waves:
        periods = max(periods, order * abs(distance_rad) / (2 * np.pi))
    shown = min(SHOWN_BY * periods, MOST_OF_ALL)
    return int(max(np.clip(NODES_PER_PERIOD * periods, FEWEST, MOST), shown))


def swings_at_hz(model: Model) -> float:
    """How fast motor and load swing against each other; 0 where the model is rigid."""
    if model.stiffness_nm_rad is None:
        return 0.0
    mobility = 1 / model.rotor_inertia_kgm2 + 1 / model.lightest_kgm2
    return float(np.sqrt(model.stiffness_nm_rad * mobility) / (2 * np.pi))


def radau() -> tuple[Array, Array, Array]:
    """Points (d,), derivative matrix (d+1, d) of the polynomial through 0 and them, weights (d,)."""
    points = np.array(ca.collocation_points(DEGREE, "radau"))
    derivative, _, weights = ca.collocation_coeff(list(points))
    return points, np.asarray(ca.DM(derivative)), np.asarray(ca.DM(weights)).ravel()


class Programme:
    """A task as a nonlinear programme over `intervals` intervals.

    `guess_s`: about how long it takes. `losses`: in copper (W per N²m²) and iron (W per rad²/s²). `speed_torque`: pairs
    (m, 2) of speed (rad/s) and torque (N·m).
    """

    def __init__(
        self,
        task: Task,
        models: Sequence[Model],
        intervals: int,
        scales: Scales,
        guess_s: float,
        losses: tuple[float, float] | None = None,
        speed_torque: Array | None = None,
    ) -> None:
        self.task, self.models, self.intervals, self.scales = task, models, intervals, scales
        self._guess_s, self._losses, self._speed_torque = guess_s, losses, speed_torque
        self.loads = [m for m in models if m.stiffness_nm_rad is not None]
        self.size = 2 * len(self.loads)
        self._points, self._derivative, self._weights = radau()
        self.names: list[str] = []  # of the limits at one point, in the order of the rows
        self._build()

    # -- One interval ---------------------------------------------------------------------------------

    def _interval(self) -> Any:
        """CasADi function: (first, last, load at start, load at points, duration, top) -> defects, limits, costs."""
        first, last = ca.SX.sym("first", 3), ca.SX.sym("last", 3)
        start, inner = ca.SX.sym("start", self.size), ca.SX.sym("inner", self.size, DEGREE)
        duration, top, drawn = ca.SX.sym("duration"), ca.SX.sym("top"), ca.SX.sym("drawn", DEGREE)
        step = 1.0 / self.intervals
        polynomial = ca.horzcat(start, inner)
        defects, limits, costs = [], [], ca.SX.zeros(3)
        for j, at in enumerate(self._points):
            motor = motor_within(first, last, step, float(at))
            load = inner[:, j]
            now = instant(self.task, self.models, motor, load, duration, self.scales)
            if self.size:
                slope = ca.mtimes(polynomial, ca.DM(self._derivative[:, j])) / step
                rates = []
                for number in range(len(self.loads)):
                    acceleration = self.task.distance_rad * motor[2] / duration**2
                    twist_speed = self.scales.twist_speed_rad_s * load[2 * number + 1]
                    rates.append(duration * twist_speed / self.scales.twist_rad)
                    relative = acceleration - now.load_rad_s2[number]
                    rates.append(duration * relative / self.scales.twist_speed_rad_s)
                defects.append((slope - ca.vertcat(*rates)) / self.intervals)
            jerk = self.task.distance_rad * (last[2] - first[2]) / step / duration**3
            limits.append(self._limits(now, top, jerk, load, duration, motor))
            costs += float(self._weights[j]) * step * self._costs(now, duration, drawn[j], load, jerk)
            if self._draws:
                limits[-1] = ca.vertcat(limits[-1], self._power(now) / self._power_scale - drawn[j])
        return ca.Function(
            "interval",
            [first, last, start, inner, duration, top, drawn],
            [ca.vertcat(*defects) if defects else ca.SX(0, 1), ca.horzcat(*limits), costs],
            {"cse": True},  # a tenth of the time: costs and limits have much in common
        )

    def _limits(self, now: Instant, top: Any, jerk: Any, load: Any, duration: Any, motor: Any) -> Any:
        """Rows that shall be at most 0, in shares of each limit; their names go to `self.names`."""
        limit: MotionLimits = self.task.limits
        rows, names = [], []
        for torque, model in zip(now.torque_nm, self.models, strict=True):
            share = torque / self.scales.torque_nm
            bound = top if self._peak else model.torque_max_nm / self.scales.torque_nm
            rows += [share - bound, -share - bound]
            names += ["torque", "torque"]
            for low, high in self._lines():
                for sign in (1, -1):
                    for turning in (1, -1):
                        allowed = (low + high * turning * now.motor_rad_s) / self.scales.torque_nm
                        rows.append(sign * share - allowed)
                        names.append("torque over speed")
        if limit.speed_max_rad_s is not None:
            for speed in (now.motor_rad_s, *(now.load_rad_s if self.size else ())):
                rows += [speed / limit.speed_max_rad_s - 1, -speed / limit.speed_max_rad_s - 1]
                names += ["speed", "speed"]
        if limit.jerk_max_rad_s3 is not None:
            jerks = [jerk]
            for number, model in enumerate(self.loads):
                jerks.append(self._load_jerk(model, number, motor, load, duration))
            for value in jerks:
                rows += [value / limit.jerk_max_rad_s3 - 1, -value / limit.jerk_max_rad_s3 - 1]
                names += ["jerk", "jerk"]
        low_rad, high_rad = limit.position_min_rad, limit.position_max_rad
        for angle in (now.motor_rad, *(now.load_rad if self.size else ())):
            if high_rad is not None:
                rows.append((angle - high_rad) / abs(self.task.distance_rad))
                names.append("window")
            if low_rad is not None:
                rows.append((low_rad - angle) / abs(self.task.distance_rad))
                names.append("window")
        self.names = names
        return ca.vertcat(*rows)

    def _load_jerk(self, model: Model, number: int, motor: Any, load: Any, duration: Any) -> Any:
        """Jerk of a load (rad/s³): the derivative of its acceleration along the motion, by the chain rule."""
        twist, rate, angle, speed = (ca.SX.sym(name) for name in ("twist", "rate", "angle", "speed"))
        place, pace = angle - twist, speed - rate
        torque = model.shaft_torque(twist, rate)
        acceleration = (torque - model.load_needs(place, pace)) / model.load_inertia(place)
        motor_acceleration = ca.SX.sym("acceleration")
        along = ca.vertcat(rate, motor_acceleration - acceleration, speed, motor_acceleration)
        state = ca.vertcat(twist, rate, angle, speed)
        jerk = ca.jtimes(acceleration, state, along)
        function = ca.Function("jerk", [state, motor_acceleration], [jerk])
        distance = self.task.distance_rad
        return function(
            ca.vertcat(
                self.scales.twist_rad * load[2 * number],
                self.scales.twist_speed_rad_s * load[2 * number + 1],
                self.task.start_rad + distance * motor[0],
                distance * motor[1] / duration,
            ),
            distance * motor[2] / duration**2,
        )

    def _lines(self) -> list[tuple[float, float]]:
        """The torque-speed curve as lines: what each allows at no speed (N·m), and its slope (N·m·s/rad)."""
        if self._speed_torque is None:
            return []
        pairs = self._speed_torque
        slopes = np.diff(pairs[:, 1]) / np.diff(pairs[:, 0])
        return [
            (float(torque - slope * speed), float(slope))
            for (speed, torque), slope in zip(pairs, slopes, strict=False)
            if slope < 0 or torque < self.task.limits.torque_max_nm
        ]

    # -- What it costs --------------------------------------------------------------------------------

    @property
    def _peak(self) -> bool:
        return self.task.duration_s is not None and self.task.weights.get("peak", 0.0) > 0

    @property
    def _draws(self) -> bool:
        """The drawn power has to be at least 0 by an unknown of its own."""
        return self.task.weights.get("energy", 0.0) > 0 and not self.task.regeneration

    @property
    def _power_scale(self) -> float:
        return self.scales.torque_nm * abs(self.task.distance_rad) / self._guess_s

    def _power(self, now: Instant) -> Any:
        """Electrical power (W), the mean of all loads."""
        copper, iron = self._losses or (0.0, 0.0)
        power = [t * now.motor_rad_s + copper * t**2 + iron * now.motor_rad_s**2 for t in now.torque_nm]
        return sum(power[1:], power[0]) / len(power)

    def _costs(self, now: Instant, duration: Any, drawn: Any, load: Any, jerk: Any) -> Any:
        """Rates of copper (N²m²), energy (W) and vibration, per share of the duration and times it."""
        copper = sum(torque**2 for torque in now.torque_nm) / len(now.torque_nm)
        energy = drawn * self._power_scale if self._draws else self._power(now)
        if self.size:
            rates = [(self.scales.twist_speed_rad_s * load[2 * n + 1]) ** 2 for n in range(len(self.loads))]
            swing = sum(rates[1:], rates[0]) / len(rates)
        else:
            swing = jerk**2
        return duration * ca.vertcat(copper, energy, swing)

    # -- The whole stroke -----------------------------------------------------------------------------

    def _build(self) -> None:
        n, task, size = self.intervals, self.task, self.size
        motor, nodes = ca.MX.sym("motor", 3, n + 1), ca.MX.sym("node", size, n + 1)
        inner = ca.MX.sym("inner", size, (DEGREE - 1) * n)
        free = ca.MX.sym("duration", 0 if task.duration_s else 1)
        top = ca.MX.sym("top", 1 if self._peak else 0)
        drawn = ca.MX.sym("drawn", DEGREE if self._draws else 0, n)
        duration = task.duration_s if task.duration_s else self._guess_s * free
        step = 1.0 / n
        points = []
        for i in range(n):
            own = inner[:, (DEGREE - 1) * i : (DEGREE - 1) * (i + 1)]
            points.append(ca.horzcat(own, nodes[:, i + 1]))
        interval = self._interval()
        before, after = motor[:, :n], motor[:, 1:]
        defects, limits, costs = interval.map(n)(
            before,
            after,
            nodes[:, :n],
            ca.horzcat(*points) if size else ca.MX(0, DEGREE * n),
            ca.repmat(ca.MX(duration), 1, n),
            ca.repmat(top if self._peak else ca.MX(1), 1, n),
            drawn if self._draws else ca.MX(DEGREE, n),
        )
        on = after[0, :] - before[0, :] - step * before[1, :]
        on -= step**2 * (before[2, :] / 3 + after[2, :] / 6)
        faster = after[1, :] - before[1, :] - step / 2 * (before[2, :] + after[2, :])
        equal = ca.vertcat(ca.vec(on) * n, ca.vec(faster), ca.vec(defects))
        # The first instant is nobody's point, and the acceleration may begin there with a step.
        start = ca.SX.sym("start", 3), ca.SX.sym("load", size), ca.SX.sym("duration"), ca.SX.sym("top")
        now = instant(
            task, self.models, (start[0][0], start[0][1], start[0][2]), start[1], start[2], self.scales
        )
        first_rows = []
        for torque, model in zip(now.torque_nm, self.models, strict=True):
            bound = start[3] if self._peak else model.torque_max_nm / self.scales.torque_nm
            first_rows += [torque / self.scales.torque_nm - bound, -torque / self.scales.torque_nm - bound]
        beginning = ca.Function("beginning", [*start], [ca.vertcat(*first_rows)])
        at_first = beginning(motor[:, 0], nodes[:, 0], duration, top if self._peak else 1)
        below = ca.vertcat(ca.vec(limits), at_first)
        total = ca.sum2(costs)
        self.unknowns = ca.vertcat(ca.vec(motor), ca.vec(nodes), ca.vec(inner), free, top, ca.vec(drawn))
        self.constraints = ca.vertcat(equal, below)
        self.equalities, self.inequalities = equal.numel(), below.numel()
        self.totals = ca.Function("totals", [self.unknowns], [total])
        self.limits_of = ca.Function("limits", [self.unknowns], [limits])
        self.objective = self._objective(total, free, top)
        self._parts = (
            3 * (n + 1),
            size * (n + 1),
            size * (DEGREE - 1) * n,
            free.numel(),
            top.numel(),
            drawn.numel(),
        )

    def _objective(self, total: Any, free: Any, top: Any) -> Any:
        if self.task.duration_s is None:
            return free
        value: Any = ca.MX(0)
        for name, row in (("copper", 0), ("energy", 1), ("vibration", 2)):
            weight = self.task.weights.get(name, 0.0)  # type: ignore[call-overload]
            if weight:
                value += weight / self.scales.merits[name] * total[row]  # type: ignore[index]
        if self._peak:
            # Many motions have the same peak: of those, the one of least copper, which is one.
            value += TIES / self.scales.merits["copper"] * total[0]
            value += self.task.weights["peak"] * top * self.scales.torque_nm / self.scales.merits["peak"]
        return value

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest value of every unknown: at rest at both ends, wound up as the load asks."""
        n, wide = self.intervals, np.inf
        motor = np.full((3, n + 1), wide)
        low, high = -motor, motor.copy()
        low[:2, 0] = high[:2, 0] = 0.0
        low[0, n] = high[0, n] = 1.0
        low[1, n] = high[1, n] = 0.0
        loads = np.full((self.size, n + 1), wide)
        load_low, load_high = -loads, loads.copy()
        for number, model in enumerate(self.loads):
            for column, end in ((0, self.task.ends_rad[0]), (n, self.task.ends_rad[1])):
                rest = resting_twist(model, end) / self.scales.twist_rad
                if column == 0 or number == 0:  # the motion can bring one load to rest exactly, and no more
                    load_low[2 * number : 2 * number + 2, column] = (rest, 0.0)
                    load_high[2 * number : 2 * number + 2, column] = (rest, 0.0)
        inner, free, top, drawn = self._parts[2:]
        lows = [
            low.T.ravel(),
            load_low.T.ravel(),
            np.full(inner, -wide),
            np.full(free, 0.02),
            np.zeros(top),
            np.zeros(drawn),
        ]
        highs = [
            high.T.ravel(),
            load_high.T.ravel(),
            np.full(inner, wide),
            np.full(free, wide),
            np.full(top, 1 + TOP_ROOM),
            np.full(drawn, wide),
        ]
        return np.concatenate(lows), np.concatenate(highs)

    def unknowns_of(self, motor: Array, nodes: Array, inner: Array) -> Array:
        """A guess: motor (3, n+1), loads at nodes (size, n+1) and inner points (size, (d−1)·n)."""
        free, top, drawn = self._parts[3:]
        parts = [
            motor.T.ravel(),
            nodes.T.ravel(),
            inner.T.ravel(),
            np.ones(free),
            np.ones(top),
            np.ones(drawn),
        ]
        return np.concatenate(parts)

    def split(self, unknowns: Array) -> tuple[Array, Array, float]:
        """Motor (3, n+1), loads (size, n+1) and duration (s) of a solution."""
        n, parts = self.intervals, np.cumsum(self._parts)
        motor = unknowns[: parts[0]].reshape(n + 1, 3).T
        nodes = unknowns[parts[0] : parts[1]].reshape(n + 1, self.size).T
        duration = self.task.duration_s or self._guess_s * float(unknowns[parts[2]])
        return motor, nodes, duration

    def instants(self, motor: Array, nodes: Array, duration_s: float) -> Instant:
        """Everything at the nodes, arrays (n+1,)."""
        columns = (motor[0], motor[1], motor[2])
        return instant(self.task, self.models, columns, nodes, duration_s, self.scales)

    def active(self, unknowns: Array, tolerance: float = 1e-3) -> dict[str, float]:
        """Share of the points at which each limit holds the motion back."""
        rows = np.asarray(self.limits_of(unknowns)).reshape(-1, DEGREE * self.intervals, order="F")
        touched: dict[str, float] = {}
        for name in dict.fromkeys(self.names):
            of_name = [i for i, other in enumerate(self.names) if other == name]
            touched[name] = float(np.mean(np.any(rows[of_name] > -tolerance, axis=0)))
        return {name: share for name, share in touched.items() if share > 0}
