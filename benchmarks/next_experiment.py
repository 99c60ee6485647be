"""How many motions does it take until one name has 95 %: the motion that `--next` chooses, or any within the limits?

    python benchmarks/next_experiment.py --machines 12 --first 0 --minutes 15
    python benchmarks/next_experiment.py --sound --machines 100
    python benchmarks/next_experiment.py --rubbing --machines 40 --first 84000

Machines are drawn as sealed sessions draw them (sim/). Each conceals an effect that its first session, a careful stroke
made twice without and twice with an injected sine, does not tell from others: a machine counts where what was
concealed is among the rivals and no set is likelier than 0.9. Both ways go on from there, with the same candidates and
limits. Counted are the motions until one set of names has 95 % and all of its names stand out from what has none, the
budget where none does.

`--sound`: machines that conceal nothing, and the names that their first session has all the same. `--rubbing`: machines
of whose torque dry friction takes most, so that they stick wherever they rest, and what their first session names.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from explain_tally import interval_of_rate

from schwung.commissioning.commission import Wishes
from schwung.commissioning.experiments import (
    SURE,
    Experiment,
    Setting,
    faint,
    injections,
    next_experiments,
    strokes,
    told_apart,
    weighed,
)
from schwung.commissioning.limits import Limits
from schwung.commissioning.plan import PlannedRun
from schwung.drivetrain import FeedForward
from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Control, Coupling, Load, Machine, Motor
from schwung.explain.weighing.experiment import Rivals
from schwung.explain.weighing.values import NAMED
from schwung.explain.weighing.weigh import Posterior, posterior_of
from schwung.session.model import Run, Session
from schwung_sim.errors import BenchError
from schwung_sim.plants import TICK_S
from schwung_sim.plants.two_mass import TwoMassPlant
from schwung_sim.sealed.hiding import hide, make_plant
from schwung_sim.sealed.loop import PlayedAxis
from schwung_sim.sealed.machines import DrawnMachine, draw_machine
from schwung_sim.sealed.strength import floor_nm, play_runs

RATE_HZ = 1000.0
#: What is concealed; the rival is whatever weighing finds as likely.
HIDDEN = (
    "coulomb_friction", "stribeck_friction", "local_friction", "viscous_friction", "quadratic_drag", "load_torque",
    "load_event", "cogging", "load_inertia", "torque_constant", "torque_lag", "measurement_delay",
)  # fmt: skip
#: What machines conceal that stick wherever they rest, of which strengths.
RUBBING, STUCK = (
    ("coulomb_friction", "stribeck_friction", "asymmetric_friction", "local_friction"),
    (20.0, 200.0),
)
#: Of the floor, drawn evenly in the logarithm; and what the likeliest set may have at most for a machine to count.
STRENGTHS, CONFUSED = (3.0, 20.0), 0.9
#: The first stroke, over the one that the machine is for, in the longest time: whoever knows little begins carefully.
CAUTIOUS = 0.35
#: Motions that are made at most, each experiment two of them.
BUDGET = 8
LONGEST_S = 4.0


@dataclass(eq=False)
class Room:
    """A machine that conceals an effect, its axis, and what is known of it."""

    drawn: DrawnMachine
    hidden: str
    axis: PlayedAxis
    setting: Setting
    chance: np.random.Generator

    @classmethod
    def drawn_by(
        cls, seed: int, hidden: Sequence[str] = HIDDEN, strengths: tuple[float, float] = STRENGTHS
    ) -> Room | None:
        """The machine of a seed that conceals one of these; None where it cannot."""
        chance = np.random.default_rng([seed, 97])
        drawn = _careful(draw_machine(chance))
        name = hidden[seed % len(hidden)]
        size = float(np.exp(chance.uniform(*np.log(strengths)))) * floor_nm(drawn)
        silent = play_runs(drawn, TwoMassPlant(drawn.drive, drawn.profile, seed=seed), seed)
        effect = hide(seed, chance, drawn, name, size, silent)
        if effect is None:
            return None
        plant = make_plant(drawn, {effect.physics: effect.parameters}, seed)
        axis = PlayedAxis(plant, drawn.settings, seed)
        axis.energise(True)
        return cls(drawn, name, axis, _setting(drawn), chance)

    @classmethod
    def sound(cls, seed: int) -> Room:
        """The machine of a seed that conceals nothing."""
        chance = np.random.default_rng([seed, 97])
        drawn = _careful(draw_machine(chance))
        axis = PlayedAxis(make_plant(drawn, {}, seed), drawn.settings, seed)
        axis.energise(True)
        return cls(drawn, "", axis, _setting(drawn), chance)

    def first(self) -> list[Run]:
        """The first session: a careful stroke twice without and twice with an injected sine."""
        return [run for _ in range(2) for run in self.record(self.setting.done)]

    def record(self, wishes: Wishes) -> list[Run]:
        """What the machine makes of some wishes."""
        return [self.play(planned) for planned in self.setting.plan(wishes).runs()]

    def play(self, planned: PlannedRun) -> Run:
        """One run, as reported."""
        noise, every = self.drawn.noise, round(1 / (RATE_HZ * TICK_S))
        ticks = np.arange(round(planned.motion.total_s / TICK_S)) * TICK_S
        demand, sine = planned.motion.demand(ticks).position_rad, planned.excitation
        added = sine.torque(ticks) if sine else np.zeros_like(ticks)
        rest = round(0.1 / TICK_S)
        jitter = noise.position_rad * self.chance.standard_normal(rest + ticks.size)
        self.axis.play(np.zeros(rest), np.zeros(rest), jitter[:rest])
        rows = self.axis.play(demand, added, jitter[rest:])[
            every - 1 :: every
        ]  # as a bus samples: what an interval led to
        rows = rows + self.chance.standard_normal(rows.shape) * (0.0, noise.speed_rad_s, noise.torque_nm)
        return Run(
            role=planned.role,
            repeat=planned.repeat,
            sample_rate_hz=RATE_HZ,
            time_s=np.arange(rows.shape[0]) / RATE_HZ,
            position_rad=rows[:, 0].copy(),
            speed_rad_s=rows[:, 1].copy(),
            torque_nm=rows[:, 2].copy(),
            torque_added_nm=added[every - 1 :: every].copy(),
            motion=planned.motion,
            excitation=sine,
        )


def _careful(drawn: DrawnMachine) -> DrawnMachine:
    """The machine with the first session alone, by which strength is counted: the short stroke in the longest time."""
    longest = max(run.stroke.duration_s for run in drawn.runs)
    runs = [
        replace(
            run,
            stroke=replace(run.stroke, distance_rad=CAUTIOUS * run.stroke.distance_rad, duration_s=longest),
        )
        for run in drawn.runs
        if run.stroke.duration_s == longest
    ]
    chosen = [run for run in runs if run.injection is None][:2] + [run for run in runs if run.injection][:2]
    return replace(drawn, rate_hz=RATE_HZ, runs=tuple(chosen))


def _setting(drawn: DrawnMachine) -> Setting:
    """The belief, which is right but for what is concealed, and limits with a quarter to spare."""
    drive, settings, stroke = drawn.drive, drawn.settings, drawn.runs[0].stroke
    distance = drawn.distance_rad / CAUTIOUS
    low, high = min(0.0, distance), max(0.0, distance)
    angle = np.linspace(low - 2.5, high + 2.5, 1501)
    machine = Machine(
        name="drawn",
        motor=Motor(
            inertia_kgm2=drive.rotor_inertia_kgm2,
            viscous_friction_nms=drive.rotor_viscous_nms,
            peak_torque_nm=drive.peak_torque_nm,
        ),
        coupling=Coupling(stiffness_nm_rad=drive.stiffness_nm_rad, damping_nms=drive.damping_nms),
        load=Load(
            viscous_friction_nms=drive.load_viscous_nms,
            inertia_table=InertiaTable(angle, drawn.profile.at(angle)),
        ),
        control=Control(
            position_gain_per_s=settings.position_gain_1_s,
            speed_gain_nms=settings.speed_gain_nms_rad,
            speed_integral_time_s=settings.speed_integral_time_s,
            sample_rate_hz=1 / TICK_S,
        ),
    )
    duration = stroke.duration_s
    limits = Limits(
        position_min_rad=low - 0.25 * abs(distance),
        position_max_rad=high + 0.25 * abs(distance),
        speed_max_rad_s=2.5 * drawn.peak_speed_rad_s / CAUTIOUS,
        torque_max_nm=drive.peak_torque_nm,
        following_error_rad=abs(distance),
    )
    amplitude = max(run.injection.amplitude_nm for run in drawn.runs if run.injection)
    done = Wishes(
        distance_rad=drawn.distance_rad,
        duration_s=duration,
        kind=stroke.kind,
        frequency_hz=drawn.injection_hz,
        amplitude_nm=amplitude,
        repeats=1,
    )
    forward = FeedForward(speed_share=settings.speed_feed_forward)
    # the drive makes the sine itself: what its steps would leave in the loop is not what is asked here
    return Setting(done, limits, 0.0, machine, torque_held=False, feed_forward=forward, longest_s=LONGEST_S)


def weighed_session(runs: list[Run], room: Room) -> Posterior:
    """All runs fitted: the proof is not what is asked here."""
    return posterior_of(Session(tuple(runs), "", "benchmark"), room.setting.machine, heldout=())


def chosen(rivals: Rivals, room: Room) -> Experiment | None:
    """The motion that tells most."""
    return next(iter(next_experiments(rivals, room.setting)), None)


def by_chance(rivals: Rivals, room: Room) -> Experiment | None:
    """Any of the same candidates within the same limits."""
    every = list(strokes(room.setting))
    for _ in range(200):
        stroke = every[int(room.chance.integers(len(every)))]
        offers = [stroke, *injections(room.setting, stroke)]
        found = weighed(rivals, room.setting, offers[int(room.chance.integers(len(offers)))])
        if found is not None:
            return found
    return None


#: How the next motion is found.
Choice = Callable[[Rivals, Room], Experiment | None]


@dataclass(frozen=True)
class Way:
    """How it went: motions until one set had 95 % (the budget where none had), and whether it was right."""

    motions: int
    settled: bool
    right: bool
    promised: float
    said: str


def gone(first: list[Run], start: Rivals, room: Room, choose: Choice) -> Way:
    """Motions after the first session until one set has 95 %."""
    runs, rivals, steps, promised, weak = list(first), start, [], 0.0, ""
    motions = 0
    while motions < BUDGET and rivals.best < SURE:
        experiment = choose(rivals, room)
        if experiment is None:
            steps.append("nothing worth making")
            break
        promised = promised or experiment.gain.expected
        runs += room.record(experiment.wishes)
        motions += experiment.motions
        posterior = weighed_session(runs, room)
        rivals = Rivals.of(posterior)
        weak = faint(posterior.told, rivals.rivals)
        w = experiment.wishes
        steps.append(
            f"{w.distance_rad:.2f} rad {w.duration_s:.2f} s {w.amplitude_nm or 0:.3g} N·m {w.frequency_hz or 0:.0f} Hz"
            f" (expected {experiment.gain.expected:.2f}) → {told_apart(rivals.rivals)}"
        )
    if rivals.best >= SURE and weak:
        steps.append(weak)
    settled = rivals.best >= SURE and not weak
    right = rivals.rivals[0].names == (room.hidden,)
    return Way(motions if settled else BUDGET, settled, right, promised, "; ".join(steps))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machines", type=int, default=12, help="confused ones, at most")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--minutes", type=float, default=15.0, help="of processor time, at most")
    parser.add_argument(
        "--sound", action="store_true", help="machines that conceal nothing: count false names"
    )
    parser.add_argument("--rubbing", action="store_true", help="machines that stick: count their names")
    options = parser.parse_args()
    if options.sound or options.rubbing:
        seeds = range(options.first, options.first + options.machines)
        after_one_stroke(seeds, options.minutes, rubbing=options.rubbing)
        return
    began, ways, seed, looked = time.process_time(), [], options.first, 0
    while len(ways) < options.machines and time.process_time() - began < 60 * options.minutes:
        seed += 1
        try:
            room = Room.drawn_by(seed)
            if room is None:
                continue
            first = room.first()
            start = Rivals.of(weighed_session(first, room))
        except BenchError:
            continue
        looked += 1
        print(f"{seed} hides {room.hidden}: {told_apart(start.rivals)}", flush=True)
        if start.best > CONFUSED or not any(room.hidden in one.names for one in start.rivals):
            continue
        pair = []
        for name, choose in (("chosen", chosen), ("chance", by_chance)):
            spent = time.process_time()
            way = gone(first, start, room, choose)
            pair.append(way)
            print(
                f"    {name} {way.motions} motions{'' if way.settled else ', not settled'}, "
                f"{'right' if way.right else 'WRONG'}, {time.process_time() - spent:.0f} s: {way.said}",
                flush=True,
            )
        ways.append(pair)
    print(f"{len(ways)} confused of {looked} machines, {(time.process_time() - began) / 60:.1f} min")
    if ways:
        summary(ways)


def after_one_stroke(seeds: Sequence[int], minutes: float, *, rubbing: bool) -> None:
    """Names of more than one half that a careful stroke shows of sound machines, or of such that stick, and how often
    one is wrong, or what is concealed is named, with 95 %."""
    began, looked, wrong, right = time.process_time(), 0, 0, 0
    for seed in seeds:
        if time.process_time() - began > 60 * minutes:
            break
        try:
            room = Room.drawn_by(seed, RUBBING, STUCK) if rubbing else Room.sound(seed)
            if room is None:
                continue
            told = weighed_session(room.first(), room).told
        except BenchError:
            continue
        named = {one.name: one.probability for one in told.names if one.probability > NAMED}
        looked, right = looked + 1, right + (room.hidden in named)
        wrong += bool(named.keys() - {room.hidden})
        if named or rubbing:
            said = ", ".join(f"{name} {p:.2f}" for name, p in named.items()) or "nothing"
            print(f"{seed}{' hides ' + room.hidden if rubbing else ''}: {said}", flush=True)
    kind = "machines that stick" if rubbing else "sound machines"
    if rubbing:
        low, high = interval_of_rate(right, looked)
        print(
            f"{right} of {looked} {kind} have the name of what they conceal ({100 * low:.1f} … {100 * high:.1f} %)"
        )
    low, high = interval_of_rate(wrong, looked)
    print(f"{wrong} of {looked} {kind} have a wrong name ({100 * low:.1f} … {100 * high:.1f} %)")


def summary(ways: list[list[Way]]) -> None:
    """Means, their ratio, and 95 % intervals by resampling machines."""
    motions = np.array([[way.motions for way in pair] for pair in ways], dtype=float)
    chance = np.random.default_rng(0)
    drawn = motions[chance.integers(len(ways), size=(4000, len(ways)))].mean(axis=1)
    for which, name in enumerate(("chosen", "chance")):
        low, high = np.percentile(drawn[:, which], (2.5, 97.5))
        settled = sum(pair[which].settled for pair in ways)
        right = sum(pair[which].right and pair[which].settled for pair in ways)
        print(
            f"{name}: {motions[:, which].mean():.1f} motions ({low:.1f} … {high:.1f}), settled {settled}/{len(ways)}, "
            f"of these right {right}"
        )
    low, high = np.percentile(drawn[:, 0] / drawn[:, 1], (2.5, 97.5))
    ratio = motions[:, 0].mean() / motions[:, 1].mean()
    print(f"chosen over chance: {ratio:.2f} ({low:.2f} … {high:.2f})")


if __name__ == "__main__":
    main()
