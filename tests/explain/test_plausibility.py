"""What does not fit is said before anything is explained, and proposed as data; what fits is left alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from schwung.drivetrain import Load, Machine, paper_machine, simulate
from schwung.errors import InputError
from schwung.explain.plausibility import Doubt, Plausibility, corrected, examine
from schwung.explain.plausibility.examination import lateness, plateau, wrap_period
from schwung.explain.plausibility.inertia_factor import inertia_factor
from schwung.motion import Array, Excitation, Motion
from schwung.session import Run, Session

RATE = 2000.0
COUNT = 2 * np.pi / 2**20
MACHINE = paper_machine()
RPM = 60 / (2 * np.pi)
DEGREES = 180 / np.pi


def recorded(motion: Motion, repeat: int, seed: int) -> Run:
    time = motion.time(RATE)
    made = simulate(MACHINE, motion.demand(time), time)
    noise = np.random.default_rng(seed)
    return Run(
        role="reference",
        repeat=repeat,
        sample_rate_hz=RATE,
        time_s=time,
        position_rad=np.rint(made.position_rad / COUNT) * COUNT,
        speed_rad_s=made.speed_rad_s + 0.02 * noise.standard_normal(time.size),
        torque_nm=made.torque_nm + 0.1 * noise.standard_normal(time.size),
        motion=motion,
    )


@pytest.fixture(scope="module")
def session() -> Session:
    motions = [Motion(distance_rad=np.pi, duration_s=duration) for duration in (0.25, 0.25, 0.4, 0.4)]
    runs = [recorded(motion, k % 2, k) for k, motion in enumerate(motions)]
    return Session(tuple(runs), "2024-01-01T00:00:00+00:00", "simulated")


def changed(session: Session, change: Callable[[Run], Run]) -> Session:
    return replace(session, runs=tuple(change(run) for run in session.runs))


def scaled(position: float = 1.0, speed: float = 1.0, torque: float = 1.0) -> Callable[[Run], Run]:
    return lambda run: replace(
        run,
        position_rad=run.position_rad * position,
        speed_rad_s=run.speed_rad_s * speed,
        torque_nm=run.torque_nm * torque,
    )


def only(found: Plausibility) -> Doubt:
    assert len(found.doubts) == 1, found.notes
    return found.doubts[0]


@pytest.mark.parametrize("duration_s", [0.1, 0.25, 0.8])
def test_the_believed_inertia_is_found_however_fast_it_changes(duration_s: float) -> None:
    motion = Motion(distance_rad=2 * np.pi, duration_s=duration_s)  # two swings of the crank's inertia
    session = Session(
        (recorded(motion, 0, 1), recorded(motion, 1, 2)), "2024-01-01T00:00:00+00:00", "simulated"
    )
    fitted = inertia_factor(session, MACHINE)
    assert fitted is not None
    assert fitted.known
    assert fitted.factor == pytest.approx(1.0, abs=0.05)


def test_nothing_is_doubted_about_a_sound_session(session: Session) -> None:
    assert examine(session, MACHINE).doubts == ()


@pytest.mark.parametrize(
    ("mistake", "kind"),
    [
        (scaled(speed=RPM), "speed_unit"),
        (scaled(speed=DEGREES), "speed_unit"),
        (scaled(speed=1 / (2 * np.pi)), "speed_unit"),
        (scaled(position=DEGREES), "position_unit"),
        (scaled(position=1 / (2 * np.pi)), "position_unit"),
        (scaled(position=DEGREES, speed=RPM), "position_unit"),
        (scaled(position=DEGREES, speed=DEGREES), "position_unit"),
        (scaled(torque=1e3), "torque_unit"),
        (scaled(torque=1e-3), "torque_unit"),
        (scaled(torque=-1), "torque_sign"),
        (scaled(speed=-1), "speed_sign"),
        (scaled(position=-1), "position_sign"),
    ],
)
def test_units_and_signs_are_found_and_what_is_proposed_puts_them_right(
    session: Session, mistake: Callable[[Run], Run], kind: str
) -> None:
    wrong = changed(session, mistake)
    doubt = only(examine(wrong, MACHINE))
    assert (doubt.kind, doubt.severity) == (kind, "stop")
    right = corrected(wrong, doubt.corrections)
    assert examine(right, MACHINE).doubts == ()
    for run, original in zip(right.runs, session.runs, strict=True):
        np.testing.assert_allclose(run.position_rad, original.position_rad, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(run.speed_rad_s, original.speed_rad_s, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(run.torque_nm, original.torque_nm, rtol=1e-6, atol=1e-9)


def test_two_mistakes_at_once_are_both_found(session: Session) -> None:
    found = examine(changed(session, scaled(speed=RPM, torque=-1e3)), MACHINE)
    assert found.kinds() == ("speed_unit", "torque_sign", "torque_unit")


def test_percent_of_rated_torque_is_known_where_the_rated_one_is(session: Session) -> None:
    motor = MACHINE.motor.model_copy(update={"rated_torque_nm": 7.0})
    believed = MACHINE.model_copy(update={"motor": motor})
    doubt = only(examine(changed(session, scaled(torque=100 / 7.0)), believed))
    assert "%" in doubt.text
    assert doubt.corrections[0].value == pytest.approx(0.07)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_inertia_is_no_wrong_unit(session: Session, factor: float) -> None:
    assert examine(changed(session, scaled(torque=factor)), MACHINE).doubts == ()


def test_an_inertia_far_off_is_said_without_a_unit(session: Session) -> None:
    found = examine(changed(session, scaled(torque=9.0)), MACHINE)
    assert found.kinds() == ("inertia_far_off", "torque_beyond_peak")
    doubt = found.doubts[0]
    assert (doubt.kind, doubt.severity, doubt.corrections) == ("inertia_far_off", "warning", ())


def test_an_odd_ratio_of_speed_is_no_unit(session: Session) -> None:
    doubt = only(examine(changed(session, scaled(speed=3.0)), MACHINE))
    assert doubt.kind == "speed_scale"
    assert "3 times" in doubt.text


def test_a_speed_of_something_else_is_said(session: Session) -> None:
    noise = np.random.default_rng(3)
    wrong = changed(session, lambda run: replace(run, speed_rad_s=noise.standard_normal(len(run))))
    assert examine(wrong, MACHINE).stops[0].kind == "speed_unrelated"


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0, 65536.0])
def test_wraps_are_found_with_their_size(turn: float) -> None:
    motion = Motion(distance_rad=3.0 * turn, duration_s=0.4)
    angle = motion.demand(motion.time(RATE)).position_rad + 0.3 * turn
    assert wrap_period(np.mod(angle, turn)) == pytest.approx(turn, rel=0.02)
    assert wrap_period(angle) is None


def test_a_wrapped_session_can_be_put_right(session: Session) -> None:
    wrapped = changed(
        session, lambda run: replace(run, position_rad=np.mod(run.position_rad + 5.0, 2 * np.pi))
    )
    doubt = only(examine(wrapped, MACHINE.model_copy(update={"load": turned_load(5.0)})))
    assert doubt.kind == "position_wraps"
    right = corrected(wrapped, doubt.corrections)
    for run, original in zip(right.runs, session.runs, strict=True):
        np.testing.assert_allclose(run.position_rad, original.position_rad + 5.0, atol=1e-9)


def turned_load(by_rad: float) -> Load:
    table = MACHINE.load.inertia_table
    assert table is not None
    return MACHINE.load.model_copy(
        update={"inertia_table": replace(table, position_rad=table.position_rad + by_rad)}
    )


def test_repeats_that_were_not_triggered_together_are_measured(session: Session) -> None:
    def late(values: Array) -> Array:
        return np.concatenate((np.full(31, values[0]), values[:-31]))

    second = session.runs[1]
    shifted = replace(
        second,
        position_rad=late(second.position_rad),
        speed_rad_s=late(second.speed_rad_s),
        torque_nm=late(second.torque_nm),
    )
    wrong = replace(session, runs=(session.runs[0], shifted, *session.runs[2:]))
    doubt = only(examine(wrong, MACHINE))
    assert (doubt.kind, doubt.place) == ("unsynchronised", "run 1/time")
    assert doubt.corrections[0].value == pytest.approx(31 / RATE)
    right = corrected(wrong, doubt.corrections)
    assert lateness(right.runs[0], right.runs[1]) == 0
    assert len(right.runs[1]) == len(second) - 31


def test_one_run_and_runs_without_repeats_say_what_remains(session: Session) -> None:
    one = only(examine(replace(session, runs=session.runs[:1]), MACHINE))
    assert (one.kind, one.severity) == ("one_run", "warning")
    assert "not proved" in one.still
    none = only(examine(replace(session, runs=session.runs[1:3]), MACHINE))
    assert (none.kind, none.severity) == ("no_repeats", "note")
    assert only(examine(replace(session, runs=()), MACHINE)).kind == "no_runs"


def turning(torque_slope: float = 0.0) -> Session:
    """Constant speed, twice."""
    time = np.arange(4000) / RATE
    runs = []
    for seed in range(2):
        noise = np.random.default_rng(seed).standard_normal(time.size)
        speed = 10.0 + 0.02 * noise
        runs.append(
            Run("reference", seed, RATE, time, 10.0 * time, speed, 2.0 + torque_slope * time + 0.1 * noise)
        )
    return Session(tuple(runs), "2024-01-01T00:00:00+00:00", "made up")


def test_constant_speed_shows_no_inertia() -> None:
    found = examine(turning(), MACHINE)
    assert "constant_speed" in found.kinds()
    assert found.stops == ()
    doubt = next(each for each in found.doubts if each.kind == "constant_speed")
    assert "inertia, coupling and delays cannot" in doubt.still


def test_drift_of_the_torque_is_not_taken_for_inertia() -> None:
    assert "inertia_undetermined" in examine(turning(torque_slope=3.0), MACHINE).kinds()


def test_another_inertia_over_the_angle_is_one() -> None:
    """About a number, beside dry friction, no part of a crank's stroke has the inertia of another; and an injection
    turns the motor whatever the motion does."""
    guessed = MACHINE.model_copy(update={"load": Load(inertia_kgm2=0.11)})
    time = (motion := Motion(distance_rad=np.pi, duration_s=0.25)).time(1000.0)
    made = simulate(MACHINE, motion.demand(time), time)
    rubs = 3.0 * np.tanh(made.speed_rad_s / 0.1)
    run = Run("reference", 0, 1000.0, time, made.position_rad, made.speed_rad_s, made.torque_nm + rubs)
    session = Session((run, replace(run, repeat=1)), "2024-01-01T00:00:00+00:00", "simulated")
    fitted = inertia_factor(session, guessed)
    assert fitted is not None
    assert fitted.known
    assert "inertia_undetermined" not in examine(session, guessed).kinds()
    sine = Excitation(frequency_hz=40.0, amplitude_nm=1.0, phase_rad=0.0, ramp_s=0.05, end_s=1.0)
    excited = changed(turning(torque_slope=3.0), lambda one: replace(one, excitation=sine))
    assert "inertia_undetermined" not in examine(excited, MACHINE).kinds()


def test_clipped_torque_is_found_and_compared_with_the_stated_peak(session: Session) -> None:
    clipped = changed(session, lambda run: replace(run, torque_nm=np.clip(run.torque_nm, -45.0, 45.0)))
    doubt = only(examine(clipped, MACHINE))
    assert doubt.kind == "torque_clipped"
    assert doubt.place == "runs 0, 1/torque"
    assert "45 N·m, below the stated peak of 233" in doubt.text


@pytest.mark.parametrize(
    "torque",
    [
        np.sin(np.linspace(0, 20, 3000)),
        np.rint(500 * np.sin(np.linspace(0, 20, 3000))),  # counted: several samples at the top
        np.repeat([0.0, 1.0, 0.0, -1.0], 500),  # commanded steps stand still everywhere
        np.zeros(100),
    ],
)
def test_torque_that_is_merely_smooth_or_held_is_not_clipped(torque: Array) -> None:
    assert plateau(torque) is None


def test_a_coarse_speed_is_better_derived(session: Session) -> None:
    coarse = changed(session, lambda run: replace(run, speed_rad_s=np.rint(run.speed_rad_s / 0.3) * 0.3))
    doubt = only(examine(coarse, MACHINE))
    assert doubt.kind == "speed_coarse"
    assert "0.3 rad/s" in doubt.text
    right = corrected(coarse, doubt.corrections)
    miss = right.runs[0].speed_rad_s - session.runs[0].speed_rad_s
    assert np.std(miss[20:-20]) < 0.05  # the reported noise is 0.02, a step of 0.3 has 0.087


def test_a_rigid_machine_without_a_load_is_its_motor(session: Session) -> None:
    def one_mass(run: Run) -> Run:
        acceleration = np.gradient(run.speed_rad_s, 1 / RATE)
        return replace(run, torque_nm=0.3 * acceleration)

    motor = MACHINE.motor.model_copy(update={"inertia_kgm2": 0.3})
    believed = Machine(name="rigid", motor=motor)
    assert examine(changed(session, one_mass), believed).doubts == ()
    milli = changed(changed(session, one_mass), scaled(torque=1e3))
    assert "torque_unit" in examine(milli, believed).kinds()


def test_a_stop_can_be_required_away(session: Session) -> None:
    examine(session, MACHINE).require("s.h5")
    with pytest.raises(InputError, match=r"s\.h5: all runs/speed: reported speed is 9\.549 times .* rpm"):
        examine(changed(session, scaled(speed=RPM)), MACHINE).require("s.h5")
