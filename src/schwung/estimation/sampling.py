"""What a run's samples say about the time between them.

An injected torque that a bus refreshes once per SYNC is a staircase. Sampled once per step, its images at f_s ± f
fall upon f, and the reported value belongs to the step, not to the instant: a machine of 0.11 kg·m² would be
estimated as 0.102. Averages over one step have neither error: the speed's is the difference of two positions over the
step, and the torque's is the step itself plus the controller's share, which is smooth. But the average of J_l ω is not
that of J_l times that of ω, where J_l changes on the way; so averages are turned into the values in the middle of the
step, x − h²/24 x''.

What the images leave behind, with a step of h:
- The averages of a staircase are its samples, 0.8 % more than its fundamental has at 20 samples per period; the rest
  is images, which only the rotor follows. (a₋ + 22 a + a₊)/24 is the fundamental in the middle up to (ωh)⁴.
- The rotor follows the sawtooth between staircase and fundamental, and the controller answers: by nothing on average,
  but by a share of the jumps at the instants of sampling, which depends on how late it is. Being a share of the
  injection's derivative, it looks like a delay of the injection, and `delay.py` takes it off as such.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.motion import Array
from schwung.session.model import Run, Session

#: Attribute of a run: the speed as reported (rad/s), in the middle of each step, (n,).
REPORTED_SPEED = "reported_speed_rad_s"


def prepared(session: Session) -> Session:
    """The session as the methods take it: held injections in the middle of each step, coarse speed replaced.

    A run says `hold_s` in its excitation where the injection was held for so long (its reference is treated alike),
    and "position" in the attribute `speed_source` where its reported speed is too coarse to be used. The
    reported speed is kept in the attribute REPORTED_SPEED, for what it says of the drive's filters.
    """
    if not any(is_held(run) for run in session.runs):
        return replace(session, runs=tuple(_with_speed(run) for run in session.runs))
    return replace(session, runs=tuple(_in_the_middle(run) for run in session.runs))


def is_held(run: Run) -> bool:
    """Whether the injection was held for one sampling period, as by a bus, and is recorded."""
    return run.is_held


def _in_the_middle(run: Run) -> Run:
    """Values in the middle of the steps between samples, one sample fewer.

    `torque_added` of a sample is what was in force over the step that ends with it.
    """
    added = run.torque_added_nm if run.torque_added_nm is not None else np.zeros(len(run))
    controller = run.torque_nm - added
    speed = _middle(run.speed_rad_s)
    if run.extra.get("speed_source") != "drive":
        speed = _without_average(np.diff(run.position_rad) * run.sample_rate_hz)
    return replace(
        run,
        time_s=run.time_s[1:] - 0.5 / run.sample_rate_hz,
        position_rad=_middle(run.position_rad),
        speed_rad_s=speed,
        torque_nm=fundamental(added[1:]) + _middle(controller),
        torque_added_nm=None if run.torque_added_nm is None else added[1:],
        position_demand_rad=None if run.position_demand_rad is None else _middle(run.position_demand_rad),
        extra={**run.extra, REPORTED_SPEED: _middle(run.speed_rad_s)},
    )


def fundamental(held: Array) -> Array:
    """What a staircase holds besides its images, in the middle of each step, (n,): sin(x)/x of it, x = ½ωh."""
    return _corrected(held, 1 / 24, -17 / 5760)


def _without_average(averages: Array) -> Array:
    """Values in the middle of the steps from the averages over them, (n,): x/sin(x) of them."""
    return _corrected(averages, -1 / 24, 3 / 640)


def _middle(values: Array) -> Array:
    """Values of a smooth signal in the middle of each step, (n − 1,).

    Half the sum of the step's own two would be 1.2 % low at 20 samples per period.
    """
    return _corrected((values[1:] + values[:-1]) / 2, -1 / 8, 3 / 128)


def _corrected(values: Array, second: float, fourth: float) -> Array:
    """The signal plus shares of its second and fourth differences, as far as the ends allow."""
    result = values.copy()
    for order, share in ((2, second), (4, fourth)):
        if values.size > order:
            result[order // 2 : -(order // 2)] += share * np.diff(values, order)
    return result


def _with_speed(run: Run) -> Run:
    """The run, with its speed derived from position where the reported one is too coarse."""
    if run.extra.get("speed_source") != "position":
        return run
    frequency = run.excitation.frequency_hz if run.excitation else None
    return replace(run, speed_rad_s=derived_speed(run.position_rad, run.sample_rate_hz, frequency))


def derived_speed(position_rad: Array, sample_rate_hz: float, frequency_hz: float | None) -> Array:
    """Speed (rad/s) from position by central differences, (n,); its gain at the injected frequency is put right.

    A central difference over two samples has the gain sin(x)/x, x = 2πf/f_s, and no phase.
    """
    speed = np.gradient(position_rad) * sample_rate_hz
    if frequency_hz is not None:
        x = 2 * np.pi * frequency_hz / sample_rate_hz
        speed = speed * (x / np.sin(x))
    return np.asarray(speed)
