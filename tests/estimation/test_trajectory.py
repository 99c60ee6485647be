"""The fit of the whole trajectory, held to exact physics that it does not share a line with."""

from dataclasses import replace

import numpy as np
import pytest
from estimation_plant import Hidden, crank, motion_of, record, session_of, sine_for, thinned
from scipy.integrate import solve_ivp

from schwung.drivetrain import Control, Coupling, InertiaTable, Load, Machine, Motor, simulate
from schwung.errors import InputError
from schwung.estimation import estimate, trajectory
from schwung.estimation.bound import cramer_rao
from schwung.estimation.trajectory_fit import fit
from schwung.innovations import step_kernel
from schwung.innovations.likelihood import Noise
from schwung.innovations.signals import LOSS_STD
from schwung.innovations.signals import thinned as thinned_run
from schwung.innovations.splines import Basis
from schwung.innovations.values import Shaft
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session

UNMENTIONED = Hidden(coulomb=3.0, viscous=0.2, gravity=20.0, load_torque=4.0)


def rmse(table, truth=crank):
    return float(np.sqrt(np.mean((table.inertia_kgm2 - truth(table.position_rad)) ** 2)))


@pytest.fixture(scope="module")
def recorded():
    """Reference and excited run of a motion, once each."""
    made = {}

    def of(duration, **options):
        key = (duration, *sorted(options.items()))
        if key not in made:
            motion = motion_of(duration)
            made[key] = session_of(record(motion, **options), record(motion, sine_for(motion), **options))
        return made[key]

    return of


@pytest.mark.parametrize(
    ("duration", "options", "demanded"),
    [
        (0.25, {}, 0.0006),
        (0.15, {}, 0.0008),
        (0.10, {"peak": 1e4}, 0.0010),
        (0.10, {}, 0.0020),
        (0.15, {"hidden": UNMENTIONED}, 0.0012),
        (0.10, {"hidden": UNMENTIONED}, 0.0030),
    ],
    ids=["250 ms", "150 ms", "100 ms", "100 ms clipped", "150 ms hidden", "100 ms clipped hidden"],
)
def test_table_1_machine_within_a_fifth_of_what_was_demanded(recorded, machine, duration, options, demanded):
    """1/3 profile, 50 Hz, 20 % T_max, 4 kHz, 0.02 rad/s and 0.1 N·m of noise; friction and load unmentioned."""
    result = estimate(recorded(duration, **options), machine, "trajectory")
    assert rmse(result.table) < demanded / 5
    assert result.table.position_rad.size == 64
    assert np.all(result.table.std_kgm2 < demanded / 2)


def test_frictions_are_told_beside_the_inertia(recorded, machine):
    found = fit(recorded(0.15, hidden=UNMENTIONED).runs, machine)
    at = found.model.layout
    assert found.converged
    assert found.parameters[at.coulomb] == pytest.approx(3.0, abs=0.05)
    assert found.parameters[at.viscous] == pytest.approx(0.2, abs=0.01)
    assert found.noise.torque_nm == pytest.approx(0.1, rel=0.25)
    assert found.noise.speed_rad_s == pytest.approx(0.02, rel=0.1)


def test_thinned_recordings_say_the_same(machine):
    """8 kHz, four samples to one: as accurate as its own band says, noise told of the samples as recorded."""
    motion = motion_of(0.15)
    session = session_of(record(motion, rate=8000.0), record(motion, sine_for(motion), rate=8000.0))
    found = fit(session.runs, machine)
    assert found.every >= 3
    assert found.noise.torque_nm == pytest.approx(0.1, rel=0.25)
    grid = np.linspace(0.1, np.pi - 0.1, 60)
    inertia, deviation = found.inertia_at(grid)
    assert np.sqrt(np.mean(((inertia - crank(grid)) / deviation) ** 2)) < 2
    assert np.sqrt(np.mean((inertia - crank(grid)) ** 2)) < 1e-4


def test_what_a_filter_may_have_taken_off_is_in_the_band(recorded, machine):
    """γω² of 1 % either way in torque and speed moves what rests on the injection; the motion tells some, too."""
    session = recorded(0.15)
    loss = 0.01 / (2 * np.pi * 50) ** 2
    unsure = [replace(run, extra={LOSS_STD: loss}) for run in session.runs]
    plain, found = (fit(runs, machine) for runs in (session.runs, unsure))
    grid = np.linspace(0.3, 2.8, 20)
    (inertia, before), (same, after) = plain.inertia_at(grid), found.inertia_at(grid)
    np.testing.assert_allclose(same, inertia, rtol=1e-6)
    share = np.sqrt(after**2 - before**2) / inertia
    assert np.all((share > 2e-4) & (share < 0.01))


def test_constant_inertia_comes_out_constant(recorded, machine):
    table = estimate(thinned(recorded(0.15, inertia=0.1), 2), machine, "trajectory").table
    assert np.max(np.abs(table.inertia_kgm2 - 0.1)) < 1e-4


def test_a_rigid_machine(recorded, rigid):
    table = estimate(thinned(recorded(0.15, rigid=True), 2), rigid, "trajectory").table
    assert rmse(table) < 2e-4


def test_late_speed_and_a_wrong_stiffness_are_found(recorded, machine):
    """Speed two samples late, stiffness a quarter too high in the file: neither touches the inertia."""
    session = recorded(0.15)
    late = tuple(replace(r, speed_rad_s=np.r_[r.speed_rad_s[:1], r.speed_rad_s[:1], r.speed_rad_s[:-2]])
                 for r in session.runs)  # fmt: skip
    stiff = machine.model_copy(
        update={"coupling": Coupling(stiffness_nm_rad=1.25 * 24963.0, damping_nms=8.62)}
    )
    found = fit(late, stiff)
    at = found.model.layout
    assert found.parameters[at.speed_delay] == pytest.approx(0.5e-3, abs=1e-5)
    assert found.parameters[at.stiffness] == pytest.approx(-np.log(1.25), abs=0.01)
    inertia, _ = found.inertia_at(np.linspace(0.1, 3.0, 30))
    assert np.max(np.abs(inertia - crank(np.linspace(0.1, 3.0, 30)))) < 2e-4


def test_wrong_sign_of_torque_is_an_error(recorded, machine):
    session = thinned(recorded(0.15), 4)
    wrong = replace(session, runs=tuple(replace(run, torque_nm=-run.torque_nm) for run in session.runs))
    with pytest.raises(InputError, match="sign of torque"):
        estimate(wrong, machine, "trajectory")


# Sampled and held control ---------------------------------------------------------------------------------


def _machine(inertia):
    angle = np.linspace(-0.5, 3.7, 400)
    return Machine(
        name="held-out",
        motor=Motor(inertia_kgm2=0.003, viscous_friction_nms=0.02, peak_torque_nm=40.0),
        coupling=Coupling(stiffness_nm_rad=6000.0, damping_nms=1.0),
        load=Load(viscous_friction_nms=0.02, inertia_table=InertiaTable(angle, inertia(angle))),
        control=Control(
            position_gain_per_s=50.0, speed_gain_nms=1.5, speed_integral_time_s=15e-3, sample_rate_hz=8000.0
        ),
    )


def _bent(angle):
    return 0.012 + 0.010 * np.exp(-(((angle - 1.9) / 0.5) ** 2)) + 0.004 * np.cos(angle) ** 2


def _bus_session(seed, duration, *, held, speed_noise=0.1, torque_noise=0.2):
    """What a drive reports at 1 kHz, with 20-bit angle; the injection held for 1 ms or not."""
    rate, finer = 1000.0, 8
    rng = np.random.default_rng(seed)
    motion = Motion(distance_rad=3.0, duration_s=duration, start_time_s=0.1, dwell_s=0.1)
    excitation = Excitation(frequency_hz=50.0, amplitude_nm=8.0, ramp_s=0.04, end_s=motion.total_s - 0.01,
                            hold_s=1 / rate if held else None)  # fmt: skip
    fine = motion.time(finer * rate)
    runs = []
    for role in ("reference", "excited"):
        commanded_at = fine[np.arange(fine.size) // finer * finer] if held else fine
        torque = excitation.torque(commanded_at) if role == "excited" else np.zeros_like(fine)
        made = simulate(_machine(_bent), motion.demand(fine), fine, torque, hold_torque_added=True)
        count = made.position_rad[finer::finer].size
        time = np.arange(count) / rate
        runs.append(
            Run(
                role=role, repeat=0, sample_rate_hz=rate, time_s=time, motion=motion,
                position_rad=np.round(made.position_rad[finer::finer] * 2**20 / 2 / np.pi) * 2 * np.pi / 2**20,
                speed_rad_s=made.speed_rad_s[finer::finer] + speed_noise * rng.normal(size=count),
                torque_nm=made.torque_nm[finer - 1 : -1 : finer] + torque_noise * rng.normal(size=count),
                torque_added_nm=torque[finer - 1 : -1 : finer], excitation=excitation if role == "excited" else None,
            )
        )  # fmt: skip
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="simulated")


def _believed():
    machine = _machine(_bent)
    return machine.model_copy(update={"load": Load(viscous_friction_nms=0.02)})


def test_held_injection_at_1_khz_is_estimated_from_the_raw_runs():
    table = estimate(_bus_session(0, 0.2, held=True), _believed(), "trajectory").table
    assert rmse(table, _bent) < 0.01 * 0.015


def test_the_band_is_calibrated():
    """Over machines' worth of noise 95 % bands contain the truth; neither empty nor boastful."""
    errors = []
    for seed in range(4):
        table = estimate(
            _bus_session(seed, 0.12, held=False, speed_noise=0.3, torque_noise=0.6), _believed(), "trajectory"
        ).table
        errors.append((table.inertia_kgm2 - _bent(table.position_rad)) / table.std_kgm2)
    inside = float(np.mean(np.abs(errors) < 1.96))
    assert 0.85 < inside <= 1.0
    assert 0.5 < float(np.sqrt(np.mean(np.square(errors)))) < 1.5


#: An encoder of 20 bit: an angle without any error would have no bound worth naming.
COUNT = 2 * np.pi / 2**20


def counted(session):
    return replace(
        session,
        runs=tuple(replace(r, position_rad=np.round(r.position_rad / COUNT) * COUNT) for r in session.runs),
    )


@pytest.mark.parametrize(
    ("duration", "options"),
    [(0.15, {}), (0.10, {"peak": 1e4}), (0.10, {})],
    ids=["150 ms", "100 ms", "100 ms clipped"],
)
def test_what_auto_takes_errs_no_more_than_one_and_a_half_times_the_bound(
    recorded, machine, duration, options
):
    """All angles count, those beyond the motor's turning points, where the coupling lets the load swing on, as well."""
    session = counted(recorded(duration, **options))
    found = estimate(session, machine)
    assert found.method == "trajectory"
    low, high = found.table.position_rad[[0, -1]]
    assert low < min(run.position_rad.min() for run in session.runs)
    assert high > max(run.position_rad.max() for run in session.runs)
    angle = np.linspace(low - 0.5, high + 0.5, 600)
    true = Load(viscous_friction_nms=0.1, inertia_table=InertiaTable(angle, crank(angle)))
    noise = Noise(torque_nm=0.1, speed_rad_s=0.02, position_rad=COUNT / np.sqrt(12))
    least = cramer_rao(session, machine.model_copy(update={"load": true}), noise=noise)
    assert rmse(found.table) < 1.5 * least.rms_kgm2


# Parts ----------------------------------------------------------------------------------------------------


def test_a_step_is_exact():
    """Against scipy's integration of the same equations, torques a parabola over the step."""
    shaft = Shaft(0.012, 0.2, 0.1, 24963.0, 8.62, False)
    inertia, duration = 0.09, 1e-3
    torque = np.array([5.0, -2.0, 9.0, 1.0, 0.7, 0.3])  # start, end, height; motor and load each
    first = np.array([0.2, 3.0, 1e-3, 2.5])

    def rates(t, x):
        u = t / duration
        motor, load = torque[0:2] * (1 - u) + torque[2:4] * u + torque[4:6] * 4 * u * (1 - u)
        coupling = 24963.0 * x[2] + 8.62 * (x[1] - x[3])
        return [
            x[1],
            (motor - 0.2 * x[1] - coupling) / 0.012,
            x[1] - x[3],
            (load - 0.1 * x[3] + coupling) / inertia,
        ]

    true = solve_ivp(rates, (0, duration), first, rtol=1e-11, atol=1e-13).y[:, -1]
    step = step_kernel.steps(shaft, np.array([inertia]), duration)[0]
    np.testing.assert_allclose(step @ np.concatenate([first, torque]), true, rtol=1e-8, atol=1e-11)


def test_halving_pieces_changes_no_curve():
    basis = Basis(-0.2, 3.1, 7)
    coefficients = np.random.default_rng(0).normal(size=basis.size)
    angle = np.linspace(-0.2, 3.1, 101)
    finer = basis.finer()
    for before, after in zip(basis.rows(angle), finer.rows(angle), strict=True):
        np.testing.assert_allclose(after @ basis.refined(coefficients), before @ coefficients, atol=1e-10)


def test_a_curve_goes_straight_on_beyond_its_range():
    basis = Basis(-0.2, 3.1, 7)
    coefficients = np.random.default_rng(1).normal(size=basis.size)
    ends, beyond = np.array([-0.2, 3.1]), np.array([-0.3, 3.25])
    value, slope = (rows @ coefficients for rows in basis.rows(ends))
    further, still = (rows @ coefficients for rows in basis.rows(beyond))
    np.testing.assert_allclose(further, value + slope * (beyond - ends), atol=1e-12)
    np.testing.assert_allclose(still, slope, atol=1e-12)


def test_a_fast_motion_keeps_its_samples(recorded, machine):
    """Two in each piece of the curve: steps as long as a piece bend it."""
    run = recorded(0.25).runs[0]
    slow, fast = (thinned_run(run, machine, 90.0, pieces_hz).sample_rate_hz for pieces_hz in (300.0, 900.0))
    assert slow == 1000.0
    assert fast == 2000.0


@pytest.mark.parametrize("factor", [1e3, 1e-6])
def test_a_torque_in_another_unit_is_an_error_or_a_verdict_never_a_traceback(recorded, machine, factor):
    session = thinned(recorded(0.15), 4)
    wrong = replace(
        session, runs=tuple(replace(run, torque_nm=factor * run.torque_nm) for run in session.runs)
    )
    said = ""
    try:
        verdict = estimate(wrong, machine, method="trajectory").trust.verdict
    except InputError as error:
        verdict, said = "refused", str(error)
    assert verdict != "good"
    assert (verdict == "refused") == ("torque" in said)


@pytest.mark.parametrize("runaway", [26.0, 900.0])
def test_a_coupling_that_no_machine_has_is_refused_and_never_a_traceback(
    recorded, machine, monkeypatch, runaway
):
    """As of a bus that stalled between its samples: a stiffness of 4e11 N·m/rad."""

    def run_away(*given, **options):
        found = fit(*given, **options)
        found.parameters[found.model.layout.stiffness] = runaway
        return found

    monkeypatch.setattr(trajectory, "fit", run_away)
    with pytest.raises(InputError, match=r"fits no coupling: .* times as stiff as the machine file"):
        estimate(thinned(recorded(0.15), 4), machine, method="trajectory")
