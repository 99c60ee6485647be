"""What a run's samples say about the time between them.

An injected torque that a bus refreshes once per SYNC is a staircase. Sampled once per step, its images at f_s ± f
fall upon f, and the reported value belongs to the step, not to the instant: a machine of 0.11 kg·m² would be
estimated as 0.102. Averages over one step have neither error. The speed's average is the difference of two
positions over the step, and the torque's is the step itself plus the controller's share, which is smooth.

What the images leave behind, with a step of h:
- The averages of a staircase are its samples, 0.8 % more than its fundamental has at 20 samples per period; the rest
  is images, which only the rotor follows. (a₋ + 10 a + a₊)/12 is the fundamental's average up to (ωh)⁴.
- The rotor follows the sawtooth between staircase and fundamental, and the controller answers: by nothing on average,
  but by a share of the jumps at the instants of sampling, which depends on how late it is. Being a share of the
  injection's derivative, it looks like a delay of the injection, and `delay.py` takes it off as such.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schwung.motion import Array
from schwung.session.model import Run, Session

MIN_FOR_CUBIC = 3
#: Attribute of a run: the speed as reported (rad/s), averaged over each step, (n,).
REPORTED_SPEED = "reported_speed_rad_s"


def prepared(session: Session) -> Session:
    """The session as the methods take it: held injections averaged over each step, coarse speed replaced.

    A run says `hold_s` in its excitation where the injection was held for so long (its reference is averaged alike),
    and "position" in the attribute `speed_source` where its reported speed is too coarse to be used. The
    reported speed is kept in the attribute REPORTED_SPEED, for what it says of the drive's filters.
    """
    if not any(is_held(run) for run in session.runs):
        return replace(session, runs=tuple(_with_speed(run) for run in session.runs))
    return replace(session, runs=tuple(_averaged(run) for run in session.runs))


def is_held(run: Run) -> bool:
    """Whether the injection was held for one sampling period, as by a bus, and is recorded."""
    return run.is_held


def _averaged(run: Run) -> Run:
    """Averages over the steps between samples, one sample fewer, at the middle of each step.

    `torque_added` of a sample is what was in force over the step that ends with it.
    """
    added = run.torque_added_nm if run.torque_added_nm is not None else np.zeros(len(run))
    controller = run.torque_nm - added
    speed = _step_average(run.speed_rad_s)
    if run.extra.get("speed_source") != "drive":
        speed = np.diff(run.position_rad) * run.sample_rate_hz
    return replace(
        run,
        time_s=run.time_s[1:] - 0.5 / run.sample_rate_hz,
        position_rad=_step_average(run.position_rad),
        speed_rad_s=speed,
        torque_nm=fundamental(added[1:]) + _step_average(controller),
        torque_added_nm=None if run.torque_added_nm is None else added[1:],
        position_demand_rad=None
        if run.position_demand_rad is None
        else _step_average(run.position_demand_rad),
        extra={**run.extra, REPORTED_SPEED: _step_average(run.speed_rad_s)},
    )


def fundamental(held: Array) -> Array:
    """What a staircase holds besides its images, averaged over each step, (n,)."""
    smooth = held.copy()
    smooth[1:-1] = (held[:-2] + 10 * held[1:-1] + held[2:]) / 12
    return smooth


def _step_average(values: Array) -> Array:
    """Averages of a smooth signal over each step, (n − 1,): of the cubic through the two samples at either side.

    Half the sum of the step's own two would be 0.8 % low at 20 samples per period, and differ from the average that
    the difference of two positions is.
    """
    pairs = values[1:] + values[:-1]
    average = pairs / 2
    if values.size > MIN_FOR_CUBIC:
        average[1:-1] = (13 * pairs[1:-1] - values[:-3] - values[3:]) / 24
    return average


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
