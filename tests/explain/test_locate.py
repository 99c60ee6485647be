"""Residuals made from formulas over realistic motions: is the right coordinate named first, and in the right place?"""

from __future__ import annotations

import numpy as np
import pytest

from schwung.explain.locate import Residual, locate

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
}


def coloured(chance, size, std, rho):
    """AR(1) noise with a given standard deviation."""
    drive = chance.normal(size=size + 400) * np.sqrt(1 - rho**2)
    values = np.empty(size + 400)
    values[0] = chance.normal()
    for i in range(1, values.size):
        values[i] = rho * values[i - 1] + drive[i]
    return std * values[400:]


def stroke(duration_s, distance_rad, kind):
    """Acceleration (n,) of a rest-to-rest motion, from the definition of the profile."""
    t = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ / duration_s
    if kind == "third":
        shape = np.where(t < 1 / 3, 4.5, np.where(t < 2 / 3, 0.0, -4.5))
    else:
        shape = 60 * t - 180 * t**2 + 120 * t**3
    return shape * distance_rad / duration_s**2


def session(seed, effect=None, ratio=10.0, rho=0.6, runs=16):
    """A session over a random machine; returns residuals and, for effects with a place, the place."""
    chance = np.random.default_rng(seed)
    distance = chance.choice([np.pi, 2.0, 5.0, 12.0])
    kind = chance.choice(["third", "poly5"])
    slowest = chance.uniform(0.4, 0.7)
    inertia, gravity, friction = chance.uniform(0.03, 0.2), chance.uniform(0, 8), chance.uniform(0.5, 3)
    viscous = chance.uniform(0.05, 0.3)
    excited_hz = chance.choice([40.0, 50.0, 63.0])
    place, phase = None, chance.uniform(0, 2 * np.pi)
    width = chance.uniform(0.1, 0.25) * min(distance, 4.0)
    centre = chance.uniform(0.3, 0.7) * distance
    # an event early enough that the fastest motion has it too
    event_s, lasting_s = chance.uniform(0.1, 0.3) * slowest * 0.7, chance.uniform(0.03, 0.08)
    order, hertz = chance.integers(6, 60), chance.uniform(15, 35)
    raw = []
    for run in range(runs):
        duration = slowest * (1.0, 0.8, 0.65)[(run // 2) % 3]
        there = stroke(duration, distance, kind)
        rest = np.zeros(60)
        acceleration = np.r_[rest, there, rest, -there, rest]
        n = acceleration.size
        t = np.arange(n) / RATE_HZ
        speed = np.cumsum(acceleration) / RATE_HZ
        smooth = np.convolve(np.r_[[0] * 4, speed, [0] * 4], np.ones(9) / 9, "valid")
        if run % 2:
            ripple = 0.06 * np.max(np.abs(speed))
            start = chance.choice([0, 0.5, 1, 1.5]) * np.pi
            smooth = smooth + ripple * np.sin(2 * np.pi * excited_hz * t + start)
        speed = smooth
        acceleration = np.gradient(speed) * RATE_HZ
        position = np.cumsum(speed) / RATE_HZ
        into = np.where(t < 0.06 + 0.06 + duration, t - 0.06, t - (0.12 + duration))
        sign = np.sign(speed)
        torque = inertia * acceleration + gravity * np.sin(position) + friction * sign + viscous * speed
        share = run / (runs - 1)
        forms = {
            "coulomb": sign,
            "asymmetric": np.where(speed > 0, 1.0, -0.6),
            "viscous": speed,
            "drag": speed * np.abs(speed),
            "stribeck": sign * np.exp(-((speed / (0.08 * np.max(np.abs(speed)))) ** 2)),
            "tight_spot": sign
            * np.where(
                np.abs(position - centre) < width / 2,
                1 + np.cos(2 * np.pi * (position - centre) / width),
                0,
            ),
            "drift": sign * share,
            "gravity": np.sin(position + phase),
            "cogging": np.sin(order * position + phase),
            "event": np.where(
                np.abs(into - event_s) < lasting_s / 2,
                1 + np.cos(2 * np.pi * (into - event_s) / lasting_s),
                0,
            ),
            "periodic": np.sin(2 * np.pi * hertz * t + chance.uniform(0, 2 * np.pi)),
            "inertia": acceleration,
            "torque_constant": torque,
        }
        considered = (np.abs(speed) > 0.03 * np.max(np.abs(speed))) & (t > 0.05)
        raw.append((run, into, position, speed, acceleration, torque, forms, considered, duration))
    size = 0.0
    if effect is not None:
        size = ratio / np.sqrt(np.mean(np.concatenate([one[6][effect][one[7]] for one in raw]) ** 2))
    residuals = []
    for run, into, position, speed, acceleration, torque, forms, considered, _ in raw:
        noise = coloured(chance, into.size, 1.0, rho)
        values = noise + (size * forms[effect] if effect is not None else 0.0)
        torque_noise = torque + 0.02 * np.std(torque) * chance.normal(size=torque.size)
        residuals.append(
            Residual(run, RATE_HZ, into, position, speed, acceleration, torque_noise, values, considered, 1.0,
                     (run // 2) % 3)
        )  # fmt: skip
    if effect == "tight_spot":
        place = (centre - width / 2, centre + width / 2)
    if effect == "event":
        place = (event_s - lasting_s / 2, event_s + lasting_s / 2)
    if effect == "periodic":
        place = (hertz, hertz)
    return residuals, place


def overlap(one, other):
    """Intersection over union of two intervals."""
    both = min(one[1], other[1]) - max(one[0], other[0])
    return max(both, 0.0) / (max(one[1], other[1]) - min(one[0], other[0]))


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("ratio", [3.0, 30.0])
def test_the_coordinate_of_one_effect_comes_first_in_its_place(effect, ratio):
    residuals, place = session(1, effect, ratio)
    first = locate(residuals, "rotary")[0]
    assert first.coordinate == EFFECTS[effect]
    assert first.p_value < 0.01
    assert first.share_of_energy > 0.8 * ratio**2 / (1 + ratio**2)
    if effect == "periodic":
        assert first.interval[0] <= place[0] <= first.interval[1]
    elif place is not None:
        assert overlap(first.interval, place) >= 0.7


def test_noise_alone_is_not_located():
    found = [locate(session(seed, None, rho=0.9, runs=6)[0], "rotary") for seed in range(20)]
    assert sum(bool(one) for one in found) <= 1
