"""Residuals made from formulas over realistic motions: is the right coordinate named first, and in the right place?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.signal import lfilter

from schwung.explain.location import Residual, interval_of, locate
from schwung.explain.location.words import sentence

RATE_HZ = 1000.0
EFFECTS = {
    "coulomb": "direction",
    "asymmetric": "direction",
    "viscous": "speed",
    "drag": "speed",
    "stribeck": "speed",
    "tight_spot": "position",
    "drift": "run",
    "gravity": "position",
    "cogging": "position",
    "event": "time_in_motion",
    "periodic": "frequency",
    "inertia": "acceleration",
    "torque_constant": "torque",
    "saturation": "torque",
    "offset": "direction",
    "load_table": "position",
    "inertia_table": "acceleration",
}


def coloured(chance, size, std, rho):
    """AR(1) noise with a given standard deviation."""
    return std * lfilter([np.sqrt(1 - rho**2)], [1, -rho], chance.normal(size=size + 400))[400:]


def stroke(duration_s, distance_rad, kind):
    """Acceleration (n,) of a rest-to-rest motion, from the definition of the profile."""
    t = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ / duration_s
    if kind == "third":
        shape = np.where(t < 1 / 3, 4.5, np.where(t < 2 / 3, 0.0, -4.5))
    else:
        shape = 60 * t - 180 * t**2 + 120 * t**3
    return shape * distance_rad / duration_s**2


@dataclass(frozen=True)
class Machine:
    """A random machine with the places of its effects."""

    distance: float
    kind: str
    slowest_s: float
    inertia: float
    gravity: float
    friction: float
    viscous: float
    excited_hz: float
    phase: float
    width: float
    centre: float
    event_s: float
    lasting_s: float
    order: float
    hertz: float

    @classmethod
    def drawn(cls, chance, distance=None):
        distance = distance or chance.choice([np.pi, 2.0, 5.0, 12.0])
        slowest = chance.uniform(0.4, 0.7)
        return cls(
            distance, chance.choice(["third", "poly5"]), slowest, chance.uniform(0.03, 0.2), chance.uniform(0, 8),
            chance.uniform(0.5, 3), chance.uniform(0.05, 0.3), chance.choice([40.0, 50.0, 63.0]),
            chance.uniform(0, 2 * np.pi), chance.uniform(0.1, 0.25) * min(distance, 4.0),
            chance.uniform(0.3, 0.7) * distance,
            chance.uniform(0.1, 0.3) * slowest * 0.7,  # the fastest motion has it too
            chance.uniform(0.03, 0.08), chance.integers(6, 60), chance.uniform(15, 35),
        )  # fmt: skip

    def torque(self, position, speed, acceleration):
        plain = self.inertia * acceleration + self.gravity * np.sin(position)
        return plain + self.friction * np.sign(speed) + self.viscous * speed

    def place(self, effect):
        return {
            "tight_spot": (self.centre - self.width / 2, self.centre + self.width / 2),
            "event": (self.event_s - self.lasting_s / 2, self.event_s + self.lasting_s / 2),
            "periodic": (self.hertz, self.hertz),
        }.get(effect)

    def form(self, effect, *, t, into, position, speed, acceleration, share, chance):
        """What an effect of unit size leaves over, from its formula."""
        sign, torque = np.sign(speed), self.torque(position, speed, acceleration)
        peak = self.inertia * np.max(np.abs(stroke(0.65 * self.slowest_s, self.distance, self.kind)))
        topmost = 2 * self.distance / self.slowest_s
        turn = np.mod(position - self.centre + np.pi, 2 * np.pi) - np.pi
        forms = {
            "coulomb": lambda: sign,
            "asymmetric": lambda: np.where(speed > 0, 1.0, -0.6),
            "offset": lambda: np.ones_like(t),
            "viscous": lambda: speed,
            "drag": lambda: speed * np.abs(speed),
            "stribeck": lambda: sign * np.exp(-((speed / (0.08 * topmost)) ** 2)),
            "tight_spot": lambda: sign * pulse(position - self.centre, self.width),
            "tight_spot_each_turn": lambda: sign * pulse(turn, self.width),
            "drift": lambda: sign * share,
            "gravity": lambda: np.sin(position + self.phase),
            "load_table": lambda: (
                np.tanh((position - self.centre) / self.width) + 0.4 * position / self.distance
            ),
            "cogging": lambda: np.sin(self.order * position + self.phase),
            "event": lambda: pulse(into - self.event_s, self.lasting_s),
            "periodic": lambda: np.sin(2 * np.pi * self.hertz * t + chance.uniform(0, 2 * np.pi)),
            "inertia": lambda: acceleration,
            "inertia_table": lambda: (
                np.sin(position) ** 2 * acceleration + 0.5 * np.sin(2 * position) * speed**2
            ),
            "torque_constant": lambda: torque,
            "saturation": lambda: np.sign(torque) * np.maximum(np.abs(torque) - 0.72 * peak, 0),
        }
        return forms[effect]()


def pulse(away, width):
    """A raised cosine of a width from end to end."""
    return np.where(np.abs(away) < width / 2, 0.5 + 0.5 * np.cos(2 * np.pi * away / width), 0.0)


def session(seed, *effects, ratio=10.0, rho=0.6, runs=16, distance=None, measured_noise=0.02):
    """Runs of three motion times there and back, every second one with an injected sine; and the machine.

    `ratio`: root mean square of every effect over that of the noise, which is 1.
    """
    chance = np.random.default_rng(seed)
    machine = Machine.drawn(chance, distance)
    raw, forms = [], {effect: [] for effect in effects}
    for run in range(runs):
        duration = machine.slowest_s * (1.0, 0.8, 0.65)[(run // 2) % 3]
        there, rest = stroke(duration, machine.distance, machine.kind), np.zeros(60)
        speed = np.cumsum(np.r_[rest, there, rest, -there, rest]) / RATE_HZ
        speed = np.convolve(np.r_[[0] * 4, speed, [0] * 4], np.ones(9) / 9, "valid")
        t = np.arange(speed.size) / RATE_HZ
        if run % 2:
            start = chance.choice([0, 0.5, 1, 1.5]) * np.pi
            sine = np.sin(2 * np.pi * machine.excited_hz * t + start)
            speed = speed + 0.06 * np.max(np.abs(speed)) * sine
        acceleration, position = np.gradient(speed) * RATE_HZ, np.cumsum(speed) / RATE_HZ
        into = np.where(t < 0.12 + duration, t - 0.06, t - (0.12 + duration))
        torque = machine.torque(position, speed, acceleration)
        torque = torque + measured_noise * np.std(torque) * chance.normal(size=t.size)
        considered = (np.abs(speed) > 0.03 * np.max(np.abs(speed))) & (t > 0.05)
        noise = coloured(chance, t.size, 1.0, rho)
        raw.append(
            Residual(
                run,
                RATE_HZ,
                into,
                position,
                speed,
                acceleration,
                torque,
                noise,
                considered,
                1.0,
                injected_hz=(machine.excited_hz,) if run % 2 else (),
            )
        )
        for effect in effects:
            forms[effect].append(
                machine.form(
                    effect,
                    t=t,
                    into=into,
                    position=position,
                    speed=speed,
                    acceleration=acceleration,
                    share=run / max(runs - 1, 1),
                    chance=chance,
                )
            )
    for made in forms.values():
        used = np.concatenate([form[one.considered] for form, one in zip(made, raw, strict=True)])
        size = ratio / np.sqrt(np.mean(used**2))
        raw = [replace(one, missed=one.missed + size * form) for form, one in zip(made, raw, strict=True)]
    return raw, machine


def overlap(one, other):
    """Intersection over union of two intervals."""
    both = min(one[1], other[1]) - max(one[0], other[0])
    return max(both, 0.0) / (max(one[1], other[1]) - min(one[0], other[0]))


def named(residuals, axis="rotary"):
    """The coordinates, in order."""
    return [one.coordinate for one in locate(residuals, axis)]


@pytest.mark.parametrize(
    ("effect", "ratio", "seed"),
    [(effect, 3.0, 1) for effect in EFFECTS]
    + [(effect, 30.0, 2) for effect in ("tight_spot", "event", "periodic", "stribeck", "drift")],
)
def test_the_coordinate_of_one_effect_comes_first_in_its_place(effect, ratio, seed):
    residuals, machine = session(seed, effect, ratio=ratio)
    first = locate(residuals, "rotary")[0]
    assert first.coordinate == EFFECTS[effect]
    assert first.p_value < 0.01
    assert first.share_of_energy > 0.8 * ratio**2 / (1 + ratio**2)
    place = machine.place(effect)
    if effect == "periodic":
        assert first.interval[0] <= place[0] <= first.interval[1]
    elif place is not None:
        assert overlap(first.interval, place) >= 0.7


@pytest.mark.parametrize(("rho", "runs"), [(0.0, 6), (0.9, 4), (0.97, 8)])
def test_noise_alone_is_not_located(rho, runs):
    found = [named(session(seed, rho=rho, runs=runs)[0]) for seed in range(4)]
    assert not any(found)


@pytest.mark.parametrize("effect", ["coulomb", "viscous", "tight_spot", "drift", "event"])
def test_motions_in_one_direction_are_enough(effect):
    residuals, _ = session(5, effect)
    forward = [replace(one, considered=one.considered & (one.speed_rad_s > 0)) for one in residuals]
    assert named(forward)[0] == EFFECTS[effect]


@pytest.mark.parametrize(
    "effects", [("coulomb", "tight_spot"), ("coulomb", "drift"), ("gravity", "event"), ("viscous", "cogging")]
)
def test_two_effects_are_both_located(effects):
    found = locate(session(11, *effects)[0], "rotary")
    assert [one.coordinate for one in found[:2]] in (
        [EFFECTS[one] for one in effects],
        [EFFECTS[one] for one in reversed(effects)],
    )
    assert sum(one.share_of_energy for one in found) < 1.05


def test_what_only_answers_an_injection_goes_with_no_frequency_of_the_machine():
    """It goes with whatever the injection moves; a hum is there without one."""
    residuals, machine = session(12, ratio=1.0)
    shaken = [
        replace(one, missed=one.missed + 3 * bool(one.injected_hz) * np.sin(2 * np.pi * machine.excited_hz
                * np.arange(one.missed.size) / RATE_HZ + run))
        for run, one in enumerate(residuals)
    ]  # fmt: skip
    assert "frequency" not in named(shaken)
    assert named([replace(one, injected_hz=(5.0,)) for one in shaken])[0] == "frequency"
    for harmonic in (1, 3):
        every = [replace(one, injected_hz=(machine.excited_hz / harmonic,)) for one in shaken]
        assert "frequency" not in named(every)
    humming, _ = session(12, "periodic", ratio=3.0)
    few = [one for one in humming if one.injected_hz or one.run == 0]
    assert named(few)[0] == "frequency"
    assert named([replace(one, injected_hz=(machine.excited_hz,)) for one in few])[0] == "frequency"


def test_a_tight_spot_that_comes_back_every_turn_is_one_place():
    residuals, machine = session(3, "tight_spot_each_turn", distance=40.0)
    first = locate(residuals, "rotary")[0]
    assert first.coordinate == "position"
    middle = np.mod(np.mean(first.interval) - machine.centre + np.pi, 2 * np.pi) - np.pi
    assert abs(middle) < 0.1 * machine.width
    assert 0.7 < (first.interval[1] - first.interval[0]) / machine.width < 1.2
    assert "turn" in first.text


def test_coordinates_that_the_session_cannot_separate_come_both_and_the_better_first():
    residuals, _ = session(4, "inertia", ratio=3.0, runs=8, measured_noise=0.0)
    alike = [replace(one, torque_nm=0.1 * one.acceleration_rad_s2) for one in residuals]
    found = locate(alike, "rotary")
    assert {one.coordinate for one in found} == {"acceleration", "torque"}
    assert "cannot tell that from" in found[1].text
    assert found[0].share_of_energy >= found[1].share_of_energy


def test_of_coordinates_that_do_nearly_as_well_the_simplest_is_named():
    """Dry friction that eases where the axis is slow: a curve over the speed takes the last hundredth of it, too."""
    residuals, _ = session(4, ratio=1.0)
    eased = [
        replace(one, missed=one.missed + 30 * np.tanh(20 * one.speed_rad_s / np.max(one.speed_rad_s)))
        for one in residuals
    ]  # fmt: skip
    assert named(eased) == ["direction"]


def test_a_ripple_of_a_linear_axis_is_located_over_position():
    residuals, _ = session(6, ratio=1.0)
    metres = [
        replace(
            one,
            position_rad=one.position_rad / 20,
            speed_rad_s=one.speed_rad_s / 20,
            acceleration_rad_s2=one.acceleration_rad_s2 / 20,
            missed=one.missed + 3 * np.sin(2 * np.pi * one.position_rad / 20 / 0.0025),
        )
        for one in residuals
    ]
    first = locate(metres, "linear")[0]
    assert (first.coordinate, first.unit) == ("position", "m")


def test_nothing_to_look_at_gives_nothing():
    residuals, _ = session(8, "coulomb", runs=2)
    still = [replace(one, considered=np.zeros_like(one.considered)) for one in residuals]
    assert locate([], "rotary") == ()
    assert locate(still, "rotary") == ()
    silent = [replace(one, missed=np.zeros_like(one.missed)) for one in residuals]
    assert locate(silent, "rotary") == ()


def test_the_sentence_has_place_unit_and_share():
    first = locate(session(9, "tight_spot", distance=3.0)[0], "rotary")[0]
    lo, hi = first.interval
    assert f"Between {lo:.4g} and {hi:.4g} rad" in first.text
    assert f"{100 * first.share_of_energy:.0f} % of what the belief misses" in first.text


def test_interval_of_a_raised_cosine_of_a_rectangle_and_of_everywhere():
    values = np.random.default_rng(0).uniform(0, 4, 20000)
    assert overlap(interval_of(values, pulse(values - 1.3, 0.5)), (1.05, 1.55)) > 0.8
    assert overlap(interval_of(values, 1.0 * (np.abs(values - 2) < 0.3)), (1.7, 2.3)) > 0.95
    assert interval_of(values, values) == (np.min(values), np.max(values))


def test_interval_does_not_depend_on_where_the_motion_lingers():
    lingering = np.r_[np.linspace(0, 4, 4001), np.full(5000, 1.2)]
    assert interval_of(lingering, pulse(lingering - 1.3, 0.5)) == pytest.approx((1.09, 1.51), abs=0.02)


def test_interval_over_the_turn_may_pass_its_end():
    angle = np.linspace(0, 40, 40001)
    away = np.mod(angle - 0.1 + np.pi, 2 * np.pi) - np.pi
    lo, hi = interval_of(angle, pulse(away, 1.0), period=2 * np.pi)
    assert lo == pytest.approx(2 * np.pi - 0.32, abs=0.03)
    assert hi - lo == pytest.approx(0.84, abs=0.05)


def test_what_is_constant_is_not_said_to_change_with_the_direction() -> None:
    """A load of one sign pushes alike in both: "96 % goes with the direction of motion" was said of a gas spring."""
    both = sentence("direction", (-1.0, 1.0), (-1.0, 1.0), 0.96, "rotary")
    assert both.endswith("is constant, or changes with the direction of motion alone.")
    assert sentence("direction", (1.0, 1.0), (-1.0, 1.0), 0.9, "rotary") == (
        "In the positive direction, 90 % of what the belief misses is constant."
    )
