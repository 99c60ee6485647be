"""What befalls a session: drawn from a seed, one to three incidents."""

from __future__ import annotations

import random
from dataclasses import dataclass

#: In which part of a session, and how often: most of what may go wrong does so where the machine has power, is given it
#: or loses it.
STAGES = {
    "connect": 0.3, "prepare": 0.3, "set-up": 1.0, "start": 1.0, "enable": 4.0, "motion": 4.0, "off": 3.0,
    "put-back": 1.0, "export": 0.5,
}  # fmt: skip

#: What a point in a stage is counted by: its frames, its time, or how often the tool begins to wait for something,
#: since much of what it decides takes few frames and little time.
POINTS = ("frames", "time", "waits")

#: Frames that weather is for: by who sends them, and by what they are.
TARGETS = (
    "all", "to drive", "to tool", "SYNC", "RPDO", "TPDO", "SDO request", "SDO answer", "our heartbeat",
    "its heartbeat", "EMCY", "NMT",
)  # fmt: skip

#: What the drive shows of itself goes wrong where the tool judges by it: where it gives power, moves and takes it away,
#: while it waits, and for at least as long as it takes to look.
SHOWN = "what it shows"
JUDGING = ("enable", "enable", "motion", "off", "off")
#: A stop is asked for while the axis turns: on Modbus, where that lasts but a few requests, else too rarely.
MOVING = "while it moves"

#: What may go wrong, by where it does: each class is as likely as any other, and each kind within it.
CLASSES = {
    "wire": ("lose", "delay", "double", "reorder"),
    "answers": ("sdo-abort", "sdo-silence"),
    SHOWN: ("statusword", "statusword", "unseen-state", "unseen-place"),
    "drive": ("reset", "fault", "sto", "weak", "store-power-cut"),
    "drive's processor": ("heartbeat-stop", "drive-bus-off", "stall-drive", "lost-rpdo", "late-rpdo"),
    "drive's will": ("mode", "not-following", "local", "limit-switch"),
    "tool": ("kill", "interrupt", "halt", "stall-tool"),
    "adapter": ("tool-bus-off", "buffer-full"),
    "others": ("foreign-beat", "foreign-command", "moved"),
}

#: Likewise on Modbus, where there is no wire but a line, and no master but us.
LINE_CLASSES = {
    "line": ("drop", "slow", "garble", "deaf", "mute"),
    "busy": ("busy", "busy", "acknowledge"),
    "answers": ("refused", "unanswered"),
    SHOWN: ("statusword", "unseen-state", "unseen-place"),
    "drive": ("fault", "weak"),
    "tool": ("kill", "interrupt", "halt", "stall-tool"),
    MOVING: ("halt", "halt", "interrupt"),
}

#: What kind of drive it is (traits.py), with the value of it; most are as the bench's own.
TRAITS = (
    ("", 0.0), ("", 0.0), ("", 0.0), ("brake", 0.15), ("brake", 0.15), ("brake", 0.15), ("late-controlword", 0.002),
    ("late-setpoint", 0.002), ("controlword-task", 0.004), ("first-rpdo", 0.0), ("rpdo-timeout", 0.03),
)  # fmt: skip


#: How hard a Modbus drive brakes (rad/s²), which is not for us to set.
LINE_TRAITS = (("", 0.0), ("brakes", 50.0), ("brakes", 50.0), ("brakes", 200.0))
#: By bus: what may go wrong, and what kinds of drives there are.
BUSES = {"canopen": (CLASSES, TRAITS), "modbus": (LINE_CLASSES, LINE_TRAITS)}

#: How often a session begins with a creep: that takes longer than all else, and its small motions are motions, too.
CREEPS = 0.2
#: How often nobody tells the drive to switch off after a quick stop (605A).
STAYS = 0.3


#: How often, on CANopen, a drive's enable input drops when its power stage has gone on: a drive that falls back on its
#: way up, with nothing to tell why, is one that a tool may be tempted to bring up again. Drawn last.
FALLS_BACK, FALLING_BACK = 0.03, "enable-input"
#: How often, on CANopen, somebody turns the axis between plan and power, by less than a motion is refused for: who
#: takes the first setpoint for where the axis stands makes it a step. Sizes as of "moved" are about 0.5. Drawn last.
TURNS, TURNING, TURNED = 0.04, "moved", 0.16
#: How often, on CANopen, its encoder has so few counts that a slow axis shows none for a while. Drawn last.
COARSE = 0.05


@dataclass(frozen=True)
class Incident:
    """One thing that goes wrong, when, and how badly."""

    kind: str
    stage: str
    share: float  # how far into that stage
    by: str  # counted by what: see POINTS
    after_s: float | None  # so long after the incident before it instead; None: at its own point
    duration_s: float
    size: float  # 0 hardly … 1 grossly
    pick: int  # which of several, for whatever there is to choose

    def __str__(self) -> str:
        when = (
            f"{self.share:.0%} of {self.stage} by {self.by}"
            if self.after_s is None
            else f"{self.after_s:.4f} s later"
        )
        return f"{self.kind} {when}, {self.duration_s:.4f} s, size {self.size:.2f}, pick {self.pick % 1000}"


@dataclass(frozen=True)
class Scenario:
    """A seed: which session, and what befalls it."""

    seed: int
    way: int  # which of the sessions there are
    start_rad: float
    incidents: tuple[Incident, ...]
    exports: bool = False  # and stores, at the end
    creeps: bool = True  # proves signs and units first; else they are known
    stays: bool = (
        False  # the drive stays in Quick stop active, energised, from where one word leads into operation
    )
    trait: tuple[str, float] = ("", 0.0)  # of TRAITS
    bus: str = "canopen"
    coarse: bool = False  # counts of its encoder are few


def draw(seed: int, weights: tuple[float, ...], bus: str = "canopen") -> Scenario:
    """The scenario of a seed. `weights`: how often each of the ways of commissioning is taken."""
    classes, traits = BUSES[bus]
    chance = random.Random(f"campaign {seed}" if bus == "canopen" else f"campaign {bus} {seed}")
    way = chance.choices(range(len(weights)), weights)[0]
    start = chance.choice((-0.4, 0.7, -1.3, 2.0))  # never 0: that is what nothing looks like
    count = chance.choice((1, 2, 2, 3, 3))
    incidents = tuple(
        _incident(chance, classes, number > 0 and chance.random() < 0.6) for number in range(count)
    )
    exports, trait = chance.random() < 0.25, chance.choice(traits)
    creeps, stays = chance.random() < CREEPS, chance.random() < STAYS
    if bus == "canopen" and chance.random() < FALLS_BACK:
        incidents += (_falling_back(chance),)
    if bus == "canopen" and chance.random() < TURNS:
        incidents += (_turning(chance),)
    coarse = bus == "canopen" and chance.random() < COARSE
    return Scenario(seed, way, start, incidents, exports, creeps, stays, trait, bus, coarse)


def _falling_back(chance: random.Random) -> Incident:
    size, duration = chance.random(), 10 ** chance.uniform(-2.5, 0.5)
    return Incident(FALLING_BACK, "enable", 0.0, "waits", None, duration, size, 0)


def _turning(chance: random.Random) -> Incident:
    stage, size = chance.choice(("set-up", "start")), 0.5 + chance.uniform(-TURNED, TURNED)
    return Incident(TURNING, stage, chance.random(), chance.choice(POINTS), None, 0.0, size, 0)


def _incident(chance: random.Random, classes: dict[str, tuple[str, ...]], follows: bool) -> Incident:
    place = chance.choice(list(classes))
    shown, moving = place == SHOWN, place == MOVING
    kind = chance.choice(classes[place])
    stage = chance.choice(JUDGING) if shown else chance.choices(list(STAGES), list(STAGES.values()))[0]
    return Incident(
        kind=kind,
        stage="motion" if moving else stage,
        share=chance.random(),
        by="waits" if shown else "time" if moving else chance.choice(POINTS),
        after_s=10 ** chance.uniform(-4, 0) if follows else None,
        duration_s=10 ** chance.uniform(-1.5 if shown else -2.5, 0.5),
        size=chance.random(),
        pick=chance.randrange(1 << 30),
    )
