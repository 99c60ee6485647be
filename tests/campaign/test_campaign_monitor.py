"""A monitor that never complains would be worth nothing: each rule against the frames and the motion that break it."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

import can
import pytest

from schwung_sim.campaign.monitor import Expected, Monitor

PLAN = Expected(
    node_id=3, low_rad=-0.2, high_rad=0.8, speed_rad_s=10.0, torque_nm=50.0, silence_s=0.3, deceleration_rad_s2=1000.0,
    step_rad=1e-3, bend_rad=6e-4, added_counts=50, mode=8,
)  # fmt: skip


@dataclass
class Still:
    """A machine that does what the test says."""

    position_rad: float = 0.0
    speed_rad_s: float = 0.0
    torque_nm: float = 0.0
    energised: bool = False
    operating: bool = False
    stepped_down: bool = False
    mode: int = 8
    count_rad: float = 1e-5
    deaf_until_s: float = 0.0
    stands: bool = False
    excused: bool = False


class Stage:
    """A monitor, a machine and a tool that is played by hand."""

    def __init__(self) -> None:
        self.time_s, self.machine = 0.0, Still()
        self.monitor = Monitor(PLAN, self.machine, lambda: self.time_s)
        self.monitor.asked()

    def say(self, can_id: int, data: bytes, sender: str = "tool") -> None:
        self.monitor.heard(sender, can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def hear(self, can_id: int, data: bytes) -> None:
        self.monitor.reached(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def rpdo(self, word: int, target: int = 0, added: int = 0) -> None:
        self.say(0x203, struct.pack("<Hih", word, target, added))

    def pass_time(self, duration_s: float) -> None:
        for _ in range(round(duration_s * 1000)):
            self.time_s += 0.001
            self.monitor.look()

    def enable(self) -> None:
        for word in (0x00, 0x06, 0x07, 0x0F):
            self.rpdo(word)
            self.pass_time(0.005)
        self.machine.energised = self.machine.operating = True
        self.say(0x77F, b"\x05")
        self.pass_time(0.01)

    def stop(self) -> None:
        self.machine.energised = self.machine.operating = False
        self.pass_time(0.01)

    @property
    def rules(self) -> list[str]:
        return [violation.rule for violation in self.monitor.violations]


def _beyond(stage: Stage) -> None:
    stage.machine.position_rad = 0.83


def _too_fast(stage: Stage) -> None:
    stage.machine.speed_rad_s = -11.5


def _too_strong(stage: Stage) -> None:
    stage.machine.torque_nm = 50.2


def _re_enabled(stage: Stage) -> None:
    stage.rpdo(0x02)
    stage.stop()
    stage.pass_time(0.02)
    stage.machine.energised = stage.machine.operating = True


def _enabled_after_a_stop(stage: Stage) -> None:
    stage.rpdo(0x02)
    stage.rpdo(0x0F)


def _brought_up_again(stage: Stage) -> None:
    for word in (0x06, 0x07, 0x0F):
        stage.rpdo(word)


def _undone_by_sync(stage: Stage) -> None:
    stage.rpdo(0x0F)
    stage.say(0x603, struct.pack("<BHBHxx", 0x2B, 0x6040, 0, 0x02))
    stage.say(0x080, b"")


def _goes_on(stage: Stage) -> None:
    stage.hear(0x203, bytes(8))
    stage.pass_time(0.03)
    stage.rpdo(0x0F)


def _step(stage: Stage) -> None:
    for target in (50, 100, 202):
        stage.rpdo(0x0F, target)


def _step_in_the_quick_stop(stage: Stage) -> None:
    stage.rpdo(0x0F, 0)
    stage.rpdo(0x02, -102)


def _bend(stage: Stage) -> None:
    for target in (50, 100, 163, 163):
        stage.rpdo(0x0F, target)


def _torque_while_stopping(stage: Stage) -> None:
    stage.rpdo(0x02, 0, 1)


def _too_much_injected(stage: Stage) -> None:
    stage.rpdo(0x0F, 0, -51)


def _halt_bit(stage: Stage) -> None:
    stage.rpdo(0x010F)


def _fault_reset_by_sdo(stage: Stage) -> None:
    stage.say(0x603, struct.pack("<BHBHxx", 0x2B, 0x6040, 0, 0x80))


def _written_while_on(stage: Stage) -> None:
    stage.say(0x603, struct.pack("<BHBI", 0x23, 0x1016, 1, 0))


def _pre_operational_while_on(stage: Stage) -> None:
    stage.say(0x000, bytes([0x80, 3]))


def _two_that_beat(stage: Stage) -> None:
    for _ in range(8):
        beat = can.Message(arbitration_id=0x77F, data=b"\x05", is_extended_id=False)
        stage.monitor.heard("other", beat)
        stage.monitor.reached(beat)
        stage.pass_time(0.02)
    stage.rpdo(0x0F)


def _silence(stage: Stage) -> None:
    stage.pass_time(0.6)


@pytest.mark.parametrize(
    ("what", "rule"),
    [
        (_beyond, "window"),
        (_too_fast, "speed"),
        (_too_strong, "torque"),
        (_re_enabled, "re-enabled"),
        (_enabled_after_a_stop, "enable after stop"),
        (_brought_up_again, "enable after stop"),
        (_undone_by_sync, "undone by SYNC"),
        (_goes_on, "goes on"),
        (_step, "step"),
        (_step_in_the_quick_stop, "step"),
        (_bend, "bend"),
        (_torque_while_stopping, "torque added"),
        (_too_much_injected, "torque added"),
        (_halt_bit, "controlword"),
        (_fault_reset_by_sdo, "controlword"),
        (_written_while_on, "written while on"),
        (_pre_operational_while_on, "written while on"),
        (_two_that_beat, "two that beat"),
        (_silence, "dead man's motion"),
    ],
    ids=lambda value: value if isinstance(value, str) else value.__name__.strip("_"),
)
def test_each_rule_is_broken_by_what_breaks_it_and_by_nothing_before(
    what: Callable[[Stage], None], rule: str
) -> None:
    stage = Stage()
    stage.enable()
    stage.rpdo(0x0F)
    assert stage.rules == []
    what(stage)
    stage.pass_time(0.005)
    assert stage.rules == [rule]


def test_a_wrong_mode_that_could_have_been_seen() -> None:
    stage = Stage()
    stage.machine.mode = 1
    stage.pass_time(0.1)
    stage.enable()
    assert stage.rules == ["mode"]


def test_operation_without_the_way_up_or_without_being_asked() -> None:
    stage = Stage()
    stage.rpdo(0x0F)
    assert stage.rules == ["re-enabled"]
    unasked = Monitor(PLAN, Still(energised=True, operating=True), lambda: 0.0)
    unasked.look()
    assert [violation.rule for violation in unasked.violations] == ["re-enabled"]


def test_a_first_target_far_from_where_the_axis_stands() -> None:
    stage = Stage()
    stage.machine.position_rad = 0.5
    stage.enable()
    stage.rpdo(0x0F, 0)
    assert stage.rules == ["step"]


@pytest.mark.parametrize(("told", "rules"), [("", ["left energised"]), ("it may still be energised", [])])
def test_whoever_leaves_a_motor_energised_says_so(told: str, rules: list[str]) -> None:
    stage = Stage()
    stage.enable()
    stage.monitor.ended(told)
    assert stage.rules == rules


@pytest.mark.parametrize(("after_s", "rules"), [(0.005, []), (0.05, ["re-enabled"])])
def test_a_word_that_a_drive_has_in_its_queue_may_still_act_after_a_stop_was_said(
    after_s: float, rules: list[str]
) -> None:
    stage = Stage()
    stage.enable()
    stage.rpdo(0x0F)
    stage.rpdo(0x02)
    stage.machine.energised = stage.machine.operating = False
    stage.pass_time(after_s)
    stage.machine.energised = stage.machine.operating = True
    stage.pass_time(0.001)
    assert stage.rules == rules


@pytest.mark.parametrize(("runs_s", "rules"), [(0.005, []), (0.05, ["re-enabled"])])
def test_the_queue_of_a_drive_whose_processor_stands_gets_no_older(runs_s: float, rules: list[str]) -> None:
    """Campaign seed 623565: it stood, and the word that enables had come, and was not yet looked at."""
    stage = Stage()
    stage.enable()
    stage.rpdo(0x0F)
    stage.machine.stands = True
    stage.pass_time(0.05)
    stage.rpdo(0x02)
    stage.pass_time(0.1)
    stage.machine.stands = stage.machine.energised = stage.machine.operating = False
    stage.pass_time(runs_s)
    stage.machine.energised = stage.machine.operating = True
    stage.pass_time(0.001)
    assert stage.rules == rules


@pytest.mark.parametrize(("after_s", "rules"), [(0.05, []), (0.15, ["re-enabled"])])
def test_a_drive_that_left_by_itself_may_be_led_back_until_that_can_be_seen(
    after_s: float, rules: list[str]
) -> None:
    stage = Stage()
    stage.enable()
    stage.stop()
    stage.pass_time(after_s)
    stage.machine.energised = stage.machine.operating = True
    stage.pass_time(0.005)
    assert stage.rules == rules


def test_a_node_that_somebody_stopped_may_be_brought_back_to_hear_us() -> None:
    stage = Stage()
    stage.enable()
    stage.say(0x703, b"\x04", "drive")
    stage.say(0x000, bytes([0x80, 3]))
    assert stage.rules == []


@pytest.mark.parametrize(
    ("amplitude_rad", "drift_rad_s", "rules"),
    [(0.006, 0.0, []), (0.0, 0.4, ["dead man's motion"]), (0.06, 0.0, ["dead man's motion"])],
)
def test_an_axis_that_has_stopped_may_ring_but_goes_nowhere(
    amplitude_rad: float, drift_rad_s: float, rules: list[str]
) -> None:
    """A loop of 12 Hz rings at 0.45 rad/s where it is 6 mrad off (campaign seeds 431026 and 431731)."""
    stage = Stage()
    stage.enable()
    stage.machine.operating = False
    for ms in range(1000):
        phase = 2 * math.pi * 12.0 * ms / 1000
        stage.machine.position_rad = amplitude_rad * math.sin(phase) + drift_rad_s * ms / 1000
        stage.machine.speed_rad_s = amplitude_rad * 2 * math.pi * 12.0 * math.cos(phase) + drift_rad_s
        stage.pass_time(0.001)
    assert stage.rules == rules


def test_an_axis_that_stands_may_be_held_in_quick_stop() -> None:
    stage = Stage()
    stage.enable()
    stage.machine.operating = False
    stage.pass_time(1.0)
    assert stage.rules == []


@pytest.mark.parametrize(("late_s", "rules"), [(0.07, []), (0.02, ["re-enabled"])])
def test_a_word_that_was_late_on_the_wire_may_come_after_the_stop_that_was_said_since(
    late_s: float, rules: list[str]
) -> None:
    stage = Stage()
    stage.enable()
    late = can.Message(arbitration_id=0x203, data=struct.pack("<Hih", 0x0F, 0, 0), is_extended_id=False)
    stage.monitor.heard("tool", late)
    stage.monitor.under_way("drive", late, (late_s,))
    stage.rpdo(0x02)
    stage.stop()
    stage.pass_time(0.06)
    stage.machine.energised = stage.machine.operating = True
    stage.pass_time(0.01)
    assert stage.rules == rules
