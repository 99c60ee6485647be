"""A servo drive as its registers show it: what each role of the profile means for the axis."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from schwung_sim.drives.axis import TRACE_ARMED, TRACE_FULL, TRACE_IDLE, TRACE_RUNNING, ServoAxis
from schwung_sim.drives.modbus.power import PowerStage, State
from schwung_sim.drives.modbus.registers import ILLEGAL_VALUE, Cell, RefusalError, RegisterMap
from schwung_sim.errors import BenchError

PP = 1
FOLLOWING_ERROR, WATCHDOG = 0x8611, 0x7500
_NEW_SETPOINT, _AT_ONCE = 1 << 4, 1 << 5
_TARGET_REACHED, _ACKNOWLEDGED, _FOLLOWING_BIT = 1 << 10, 1 << 12, 1 << 13
_WORDS = {"16": 1, "32": 2, "64": 4}

#: What a register holds at power-on, by role, SI.
_DEFAULTS = {
    "strokes.speed": 10.0, "strokes.acceleration": 100.0, "strokes.deceleration": 100.0,
    "limits.speed_max": 315.0, "limits.torque_max": 233.0, "limits.rated_torque": 100.0,
    "limits.following_error_time": 0.01, "watchdog": 0.0,
}  # fmt: skip
_WINDOW_RAD, _FOLLOWING_RAD = 50.0, 1.5


def read_profile(path: Path) -> dict[str, Any]:
    """A profile.toml as it stands. Raises BenchError where it is none of a Modbus drive."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BenchError(f"profile {path}", f"cannot be read ({error})") from error
    if content.get("protocol") != "modbus":
        raise BenchError(f"profile {path}", "is not of a Modbus drive", 'It needs protocol = "modbus".')
    return content


def named_refs(value: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Every "@address:TYPE" in a profile, with its place in the file."""
    if isinstance(value, str) and value.startswith("@"):
        yield place, value
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from named_refs(item, f"{place}.{key}" if place else key)
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from named_refs(item, f"{place}.{number}")


class ModbusServo:
    """Registers, state machine, positioning, generator and trace around an axis. Everything happens in the thread that
    calls `read`, `write` and `advance`."""

    def __init__(self, profile: dict[str, Any], axis: ServoAxis, seed: int = 0) -> None:
        self.profile, self.axis = profile, axis
        self.power = PowerStage(axis)
        modbus = profile["modbus"]
        self.registers = RegisterMap(
            int(modbus.get("registers_per_parameter", 1)), modbus["word_order"] == "high_first"
        )
        self.moves = 0  # strokes begun, for tests: nothing may move twice
        self.reading_advances = False  # the trace's window moves on by what was read of it
        self._acknowledged = False
        self._moving = False
        self._silent_s = 0.0
        self._outside_s = 0.0
        self._roles: dict[str, tuple[Cell, float]] = {}
        self._make_window()
        self._make_table()
        for place, ref in named_refs(profile):
            if place not in ("trace.data", "export.table.values"):
                self.registers.add(ref)
        for number, entry in enumerate(profile.get("identity", [])):
            cell = self._bind(f"identity.{number}")
            if cell is not None:
                cell.value, cell.read_only = entry["value"], True
        if (cell := self._bind("serial")) is not None:
            cell.value, cell.read_only = seed, True
        self._bind_state()
        self._bind_motion()
        self._bind_settings()
        self._bind_generator_and_trace()

    # ── roles ────────────────────────────────────────────────────────────────────────────────────────────────────

    def _bind(
        self,
        place: str,
        read: Callable[[], float] | None = None,
        write: Callable[[float], None] | None = None,
        *,
        plain: bool = False,
    ) -> Cell | None:
        """The cell at a place of the profile, its hooks in SI (`plain`: in counts); None where the profile has none.
        Something that is only read is read-only."""
        part: Any = self.profile
        for step in place.split("."):
            part = (
                part[int(step)]
                if isinstance(part, list)
                else part.get(step)
                if isinstance(part, dict)
                else None
            )
            if part is None:
                return None
        ref = part if isinstance(part, str) else part["object"]
        scale = 1.0 if plain or isinstance(part, str) else float(part.get("scale", 1.0))
        cell = self.registers.add(ref)
        self._roles[place] = cell, scale
        if read is not None:
            cell.read = lambda: self._clipped(cell, read() / scale)
            cell.read_only = write is None
        if write is not None:
            cell.write = lambda counts: write(counts * scale)
        if read is None and place in _DEFAULTS:
            cell.value = round(_DEFAULTS[place] / scale)
        return cell

    @staticmethod
    def _clipped(cell: Cell, counts: float) -> float:
        if cell.code in "fd":
            return counts
        bits = {"h": 16, "H": 16, "i": 32, "I": 32, "q": 64, "Q": 64}[cell.code]
        low, high = (
            (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if cell.code.islower() else (0, (1 << bits) - 1)
        )
        return min(max(round(counts), low), high)

    def value(self, place: str, otherwise: float = 0.0) -> float:
        """What the register of a role holds, in SI; `otherwise` where the profile has no such role."""
        cell, scale = self._roles.get(place, (None, 1.0))
        return otherwise if cell is None else cell.value * scale

    @property
    def _position_scale(self) -> float:
        return float(self.profile["quantities"]["position"].get("scale", 2 * np.pi / 2**20))

    def _bind_state(self) -> None:
        power = self.power
        self._bind("state.controlword", None, lambda word: self._control(int(word)))
        self._bind("state.statusword", lambda: self.status)
        self._bind("state.error", lambda: power.error)
        mode = self._bind("state.mode", None, self._only(PP))
        if mode is not None:
            mode.value = 0
        self._bind("state.mode_display", lambda: self.value("state.mode"))
        self._bind("watchdog")
        self._bind("store", None, self._store, plain=True)

    def _store(self, value: float) -> None:
        if value != self.profile["store"]["value"]:
            raise RefusalError(ILLEGAL_VALUE)

    @staticmethod
    def _only(*values: int) -> Callable[[float], None]:
        def write(value: float) -> None:
            if value not in (0, *values):
                raise RefusalError(ILLEGAL_VALUE)

        return write

    def _bind_motion(self) -> None:
        axis, scale = self.axis, self._position_scale
        count_rad = 2 * np.pi / axis.settings.encoder_counts
        self._bind("quantities.position", lambda: axis.position_counts * count_rad / scale, plain=True)
        self._bind("quantities.speed", lambda: axis.speed_rad_s)
        self._bind("quantities.torque", lambda: axis.torque_nm)
        self._bind("quantities.position.demand", None, self._check_target)
        for name in ("speed", "acceleration", "deceleration"):
            self._bind(f"strokes.{name}", None, self._positive)
        for name in ("speed_max", "following_error_time"):
            self._bind(f"limits.{name}")
        self._bind("limits.torque_max", None, lambda nm: axis.configure(torque_limit_nm=nm))
        resolution = self._bind("quantities.position.resolution")
        if resolution is not None:
            factor = self.profile["quantities"]["position"].get("resolution_factor", 1)
            resolution.value = round(2 * np.pi / scale / factor)
        rated = self._bind("limits.rated_torque")
        if rated is not None:
            rated.read_only = True
        for name, value in (
            ("position_min", -_WINDOW_RAD), ("position_max", _WINDOW_RAD), ("following_error", _FOLLOWING_RAD),
        ):  # fmt: skip
            cell = self._bind(f"limits.{name}")
            if cell is not None:
                cell.value = round(value / scale)
        axis.configure(torque_limit_nm=self.value("limits.torque_max", axis.settings.torque_limit_nm))

    @staticmethod
    def _positive(value: float) -> None:
        if value <= 0:
            raise RefusalError(ILLEGAL_VALUE)

    def _bind_settings(self) -> None:
        axis = self.axis
        for place, name in (
            ("control.position_gain", "position_gain_1_s"),
            ("control.speed_gain", "speed_gain_nms_rad"),
            ("control.speed_integral_time", "speed_integral_time_s"),
            ("control.speed_feed_forward", "speed_feed_forward"),
            ("export.scalar", "scalar_inertia_kgm2"),
            ("export.table.start", "table_start_rad"),
            ("export.table.step", "table_step_rad"),
        ):
            self._bind_setting(place, name)
        mode = self._bind("export.table.enable") or self._bind("export.scalar.enable")
        if mode is not None:
            mode.write = lambda value: axis.configure(feed_forward_mode=int(value))
        points = self._bind("export.table.count")
        if points is not None:
            points.write = lambda value: self._load_table(int(value))

    def _bind_setting(self, place: str, name: str) -> None:
        part: Any = self.profile
        for step in place.split("."):
            part = part.get(step, {}) if isinstance(part, dict) else {}
        if not part:
            return
        ref = part if isinstance(part, str) else part["object"]
        outer: dict[str, Any] = (
            self.profile.get("export", {}).get("table", {}) if isinstance(part, str) else part
        )
        scale = float(outer.get("scale") or outer.get("scale_kgm2") or 1.0)
        if isinstance(part, str):
            scale = float(outer["angle_scale_rad"])
        cell = self.registers.add(ref)
        cell.value = round(getattr(self.axis.settings, name) / scale)
        cell.write = lambda counts: self.axis.configure(**{name: counts * scale})

    def _make_table(self) -> None:
        """The inertia table's values: parameters one after another."""
        self._table: list[Cell] = []
        table = self.profile.get("export", {}).get("table")
        if table is None:
            return
        first, kind = table["values"].removeprefix("@").split(":")
        words = max(_WORDS[kind[-2:]], self.registers.at_least)
        for number in range(table["points"]):
            cell = self.registers.add_at(int(first) + number * words, kind)
            cell.write = self._point_writer(number)
            self._table.append(cell)

    def _point_writer(self, number: int) -> Callable[[float], None]:
        def write(value: float) -> None:
            self._table[number].value = value
            self._load_table()

        return write

    def _load_table(self, points: int | None = None) -> None:
        table = self.profile["export"]["table"]
        if points is None:
            count = self._roles.get("export.table.count")
            points = int(count[0].value) if count else len(self._table)
        held = (cell.value * table["scale_kgm2"] for cell in self._table[:points])
        self.axis.configure(table_inertia_kgm2=tuple(held))

    # ── generator and trace ──────────────────────────────────────────────────────────────────────────────────────

    def _make_window(self) -> None:
        trace = self.profile.get("trace")
        if trace is not None:
            first = int(trace["data"].removeprefix("@").split(":")[0])
            self.registers.window = range(first, first + trace["window"])
            self.registers.read_window = self._trace_window
            self.registers.window_was_read = self._move_window

    def _bind_generator_and_trace(self) -> None:
        axis = self.axis
        for name, setting in (
            ("amplitude", "generator_amplitude_nm"), ("frequency", "generator_frequency_hz"),
            ("phase", "generator_phase_rad"),
        ):  # fmt: skip
            self._bind(
                f"generator.{name}",
                lambda setting=setting: getattr(axis.settings, setting),  # type: ignore[misc]  # bound early
                lambda value, setting=setting: axis.configure(**{setting: value}),  # type: ignore[misc]
            )
        self._bind("generator.control", None, self._generate)
        if "trace" in self.profile:
            self._bind("trace.divider")
            self._bind("trace.length")
            self._bind("trace.cursor")
            self._bind("trace.control", None, self._control_trace)
            self._bind("trace.status", self._trace_status)

    def _generate(self, value: float) -> None:
        words = self.profile["generator"]["control"]
        known = {words["off"]: 0, words.get("at_motion", -1): 1, words["on"]: 2}
        if int(value) not in known:
            raise RefusalError(ILLEGAL_VALUE)
        self.axis.configure(generator_control=known[int(value)])

    def _control_trace(self, value: float) -> None:
        trace = self.profile["trace"]
        if value == trace["control"]["arm"]:
            divider, length = (
                int(self.value("trace.divider", 1)),
                int(self.value("trace.length", trace["max_samples"])),
            )
            if divider < 1 or not 1 <= length <= trace["max_samples"]:
                raise RefusalError(ILLEGAL_VALUE)
            self.axis.arm_trace(divider, length)
        elif value == trace["control"].get("stop"):
            self.axis.stop_trace()
        else:
            raise RefusalError(ILLEGAL_VALUE)

    def _trace_status(self) -> int:
        words = self.profile["trace"]["status"]
        shown = {TRACE_ARMED: "armed", TRACE_RUNNING: "running", TRACE_FULL: "full"}
        status = self.axis.trace_status
        return int(words.get(shown.get(status, ""), TRACE_IDLE))

    def _trace_window(self) -> list[int]:
        """The window's registers: rows from the cursor on, as the profile's columns say."""
        trace, held = self.profile["trace"], self.axis.trace
        quantities = self.profile["quantities"]
        sources: dict[str, tuple[Any, float]] = {
            "position": (
                held.position_counts * (2 * np.pi / self.axis.settings.encoder_counts),
                self._position_scale,
            ),
            "speed": (held.speed_rad_s, quantities.get("speed", {}).get("scale", 1.0)),
            "torque": (held.torque_nm, quantities.get("torque", {}).get("scale", 1.0)),
            "torque_added": (held.torque_added_nm, 1.0),
            "position_demand": (held.demand_rad, self._position_scale),
        }
        row = sum(_WORDS[column["type"][-2:]] for column in trace["columns"])
        first = int(self.value("trace.cursor"))
        wanted = slice(first, first + trace["window"] // row)
        blocks = []
        for column in trace["columns"]:
            values, scale = sources[column["quantity"]]
            counts = np.rint(np.asarray(values[wanted]) / float(column.get("scale", scale))).astype(np.int64)
            width = _WORDS[column["type"][-2:]]
            shifts = range(width - 1, -1, -1) if self.registers.high_first else range(width)
            blocks += [(counts >> 16 * shift) & 0xFFFF for shift in shifts]
        words = np.column_stack(blocks).ravel().tolist() if blocks[0].size else []
        return [*words, *([0] * (trace["window"] - len(words)))]

    def _move_window(self, words: int) -> None:
        cursor = self._roles.get("trace.cursor")
        if self.reading_advances and cursor is not None:
            row = sum(_WORDS[column["type"][-2:]] for column in self.profile["trace"]["columns"])
            cursor[0].value += words // row

    # ── moving ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _check_target(self, counts: float) -> None:
        low, high = self.value("limits.position_min"), self.value("limits.position_max")
        if low < high and not low <= counts <= high:
            raise RefusalError(ILLEGAL_VALUE)

    def _control(self, word: int) -> None:
        rising = self.power.control(word)
        if self.power.state is not State.ENABLED:
            self._moving = False
        elif rising & _NEW_SETPOINT and self.value("state.mode") == PP:
            self._acknowledged = self._moving = True
            self.moves += 1
            self.axis.start_move(
                self.value("quantities.position.demand") * self._position_scale,
                min(self.value("strokes.speed"), self.value("limits.speed_max", np.inf)),
                self.value("strokes.acceleration"),
                self.value("strokes.deceleration"),
            )
        if not word & _NEW_SETPOINT:
            self._acknowledged = False

    @property
    def status(self) -> int:
        """The statusword."""
        word = self.power.status
        if self._moving and self.axis.target_reached:
            self._moving = False
        if not self._moving:
            word |= _TARGET_REACHED
        if self._acknowledged:
            word |= _ACKNOWLEDGED
        return word | (_FOLLOWING_BIT if self._outside_s > 0 else 0)

    def read(self, address: int, count: int) -> list[int]:
        """Answer a request. Raises RefusalError."""
        self._silent_s = 0.0
        return self.registers.read(address, count)

    def write(self, address: int, words: list[int]) -> None:
        """Carry out a request. Raises RefusalError."""
        self._silent_s = 0.0
        self.registers.write(address, words)

    def advance(self, duration_s: float) -> None:
        """Let time pass: the axis, and what the drive watches."""
        self.axis.advance(duration_s)
        self._silent_s += duration_s
        watchdog = self.value("watchdog")
        if self.power.energised:
            if watchdog > 0 and self._silent_s > watchdog:
                self.power.fail(WATCHDOG)
            self._watch_following(duration_s)
        self.power.poll()

    def _watch_following(self, duration_s: float) -> None:
        window = self.value("limits.following_error") * self._position_scale
        outside = 0 < window < abs(self.axis.following_error_rad)
        self._outside_s = self._outside_s + duration_s if outside else 0.0
        if self._outside_s > self.value("limits.following_error_time"):
            self.power.fail(FOLLOWING_ERROR)

    def weaken(self) -> None:
        """The bench's own: no torque any more; the axis is left behind."""
        self.axis.configure(torque_limit_nm=0.0)
