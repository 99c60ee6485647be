"""The online filter: equal to the batch result, exact after any number of samples, the same memory throughout."""

import math
import tracemalloc

import numpy as np
import pytest
from numba import float64, njit, typeof

from schwung.drivetrain import paper_machine, simulate
from schwung.drivetrain.response import torque_to_speed
from schwung.errors import InputError
from schwung.estimation import estimate
from schwung.estimation.online import OnlineEstimator, push_sample
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session

MACHINE = paper_machine()
RATE, FREQUENCY, WINDOW = 8000.0, 50.0, 160


def quick_pair(rate, frequency, seed=0):
    """A reference and an excited run of the paper's machine over 200 ms, with noise."""
    motion = Motion(distance_rad=np.pi, duration_s=0.2, returns=False)
    sine = Excitation(frequency_hz=frequency, amplitude_nm=46.6, ramp_s=0.04, end_s=motion.total_s)
    time, noise = motion.time(rate), np.random.default_rng(seed)
    runs = []
    for excitation in (None, sine):
        added = np.zeros_like(time) if excitation is None else excitation.torque(time)
        simulated = simulate(MACHINE, motion.demand(time), time, added)
        runs.append(
            Run(
                role="reference" if excitation is None else "excited",
                repeat=0,
                sample_rate_hz=rate,
                time_s=time,
                position_rad=simulated.position_rad,
                speed_rad_s=simulated.speed_rad_s + 0.02 * noise.normal(size=time.size),
                torque_nm=simulated.torque_nm + 0.1 * noise.normal(size=time.size),
                torque_added_nm=added,
                motion=motion,
                excitation=excitation,
            )
        )
    return Session(tuple(runs), created="2024-02-28T09:00:00+00:00", source="simulation")


def streamed(estimator, excited, reference=None):
    """Sample by sample, as beside a running drive: complex inertia and both amplitudes, (3, n)."""
    reference_torque = np.zeros(len(excited)) if reference is None else reference.torque_nm
    reference_speed = np.zeros(len(excited)) if reference is None else reference.speed_rad_s
    rows = zip(excited.torque_nm, excited.speed_rad_s, reference_torque, reference_speed, strict=True)
    return np.array([estimator.push(*row) for row in rows]).T


@pytest.mark.parametrize(
    ("rate", "frequency"), [(8000.0, 50.0), (8000.0, 100.0), (8000.0, 47.3), (1000.0, 53.7), (500.0, 61.3)]
)
@pytest.mark.parametrize("method", ["denoised", "former"])
def test_equals_the_batch_result(rate, frequency, method):
    session = quick_pair(rate, frequency)
    batch = estimate(session, MACHINE, method, remove_delay=False).traces[0]
    excited, reference = session.excited[0], session.references[0] if method == "denoised" else None
    online = OnlineEstimator(MACHINE, rate, frequency)
    inertia, speed, torque = streamed(online, excited, reference)
    used = np.isfinite(batch.inertia_kgm2)
    assert used.sum() > 0.5 * len(excited)
    expected = batch.inertia_kgm2 + 1j * batch.imaginary_kgm2
    assert np.max(np.abs(inertia[used] / expected[used] - 1)) < 1e-9
    assert np.max(np.abs(speed.real[used] / batch.speed_amplitude_rad_s[used] - 1)) < 1e-9
    assert np.max(np.abs(torque.real[used] / batch.torque_amplitude_nm[used] - 1)) < 1e-9
    assert online.lag_s == pytest.approx(excited.time_s[-1] - batch.time_s[-1], rel=1e-9)


def test_blocks_of_any_size_equal_single_samples():
    session = quick_pair(RATE, FREQUENCY)
    excited, reference = session.excited[0], session.references[0]
    online = OnlineEstimator(MACHINE, RATE, FREQUENCY)
    expected, *_ = streamed(online, excited, reference)
    online.reset()
    found = []
    for part in np.array_split(np.arange(len(excited)), [1, 7, 160, 161, 900]):
        found.append(
            online.block(
                excited.torque_nm[part],
                excited.speed_rad_s[part],
                reference.torque_nm[part],
                reference.speed_rad_s[part],
            ).inertia_kgm2
        )
    np.testing.assert_array_equal(np.concatenate(found), expected)


@pytest.mark.parametrize("frequency", [50.0, 47.3])
def test_steady_state_gives_the_true_inertia(frequency):
    """Against the response of the two-mass model, with a constant beside the sine, whole and fractional N."""
    time = np.arange(800) / RATE
    gain = torque_to_speed(MACHINE, 0.11, frequency)
    torque = 5.0 + np.real(40.0 * np.exp(2j * np.pi * frequency * time))
    speed = -3.0 + np.real(gain * 40.0 * np.exp(2j * np.pi * frequency * time))
    online = OnlineEstimator(MACHINE, RATE, frequency)
    trace = online.block(torque, speed)
    assert np.all(np.isnan(trace.inertia_kgm2[: online.window - 1]))
    np.testing.assert_allclose(trace.inertia_kgm2[online.window - 1 :], 0.11, rtol=1e-9)
    np.testing.assert_allclose(trace.torque_amplitude_nm[online.window - 1 :], 40.0, rtol=1e-9)


def test_rigid_machine():
    machine = MACHINE.model_copy(update={"coupling": None})
    time = np.arange(400) / RATE
    speed = np.real(torque_to_speed(machine, 0.07, FREQUENCY) * np.exp(2j * np.pi * FREQUENCY * time))
    trace = OnlineEstimator(machine, RATE, FREQUENCY).block(np.cos(2 * np.pi * FREQUENCY * time), speed)
    np.testing.assert_allclose(trace.inertia_kgm2[WINDOW:], 0.07, rtol=1e-9)


# ---------------------------------------------------------------------------------------------- ten million

SAMPLES = 10_000_000


@njit
def _plain_recursion(values, window, turn):
    """Equation 8 as printed; the last phasor."""
    ring, state = np.zeros(window), 0j
    for n in range(values.size):
        state = (state - ring[n % window] + values[n]) * turn
        ring[n % window] = values[n]
    return 2 * abs(state) / window


@pytest.fixture(scope="module")
def long_signals():
    """Torque and speed of a shaking, noisy, moving axis: 10⁷ samples, 20 minutes at 8 kHz."""
    noise = np.random.default_rng(5)
    period = np.arange(80_000) / RATE  # repeated; every sample is new to the filter all the same
    torque = 40 * np.sin(2 * np.pi * 47.0 * period) + 100 * np.sin(2 * np.pi * 0.5 * period)
    speed = 1.0 * np.sin(2 * np.pi * 47.0 * period + 1) + 20 * np.sin(2 * np.pi * 0.5 * period)
    torque += noise.normal(size=period.size)
    speed += 0.02 * noise.normal(size=period.size)
    repeats = SAMPLES // period.size
    return np.tile(torque, repeats), np.tile(speed, repeats)


def _exact_amplitude(values, step):
    """Least squares of sine and constant over one window, every sum rounded once only (fsum)."""
    n = values.size
    angle = [step * k for k in range(1 - n, 1)]
    basis = [[math.cos(a) for a in angle], [-math.sin(a) for a in angle], [1.0] * n]
    gram = [[math.fsum(p * q for p, q in zip(a, b, strict=True)) for b in basis] for a in basis]
    right = [math.fsum(p * x for p, x in zip(a, values.tolist(), strict=True)) for a in basis]
    cosine, sine, _ = np.linalg.solve(gram, right)
    return math.hypot(cosine, sine)


@pytest.fixture(scope="module")
def long_trace(long_signals):
    """What the filter at 50 Hz makes of them, and the filter."""
    online = OnlineEstimator(MACHINE, RATE, FREQUENCY)
    return online.block(*long_signals), online


@pytest.mark.parametrize("frequency", [FREQUENCY, 47.3, 46.9])
def test_no_drift_over_ten_million_samples(long_signals, long_trace, frequency):
    """The bound of the module's docstring, 12 N u max|x|, holds at the end as at the start."""
    torque, speed = long_signals
    memory = OnlineEstimator(MACHINE, RATE, frequency).memory_bytes
    trace, online = long_trace
    if frequency != FREQUENCY:
        online = OnlineEstimator(MACHINE, RATE, frequency)
        trace = online.block(torque, speed)
    window, step = online.window, 2 * np.pi * frequency / RATE
    bound = 12 * window * np.finfo(float).eps / 2
    at = [window - 1, 1000, *range(SAMPLES - 3 * window, SAMPLES, 47), SAMPLES - 1]
    for found, values in ((trace.torque_amplitude_nm, torque), (trace.speed_amplitude_rad_s, speed)):
        errors = [abs(found[n] - _exact_amplitude(values[n - window + 1 : n + 1], step)) for n in at]
        assert max(errors) < bound * np.max(np.abs(values))
        assert max(errors) < 1e-15 * np.max(np.abs(values))  # as measured; a drift would show here first
    assert online.memory_bytes == memory


def test_the_plain_recursion_drifts(long_signals, long_trace):
    """So that the test above can fail: what (8) as printed makes of the very same samples is ten times as far off."""
    torque, _ = long_signals
    plain = _plain_recursion(torque, WINDOW, np.exp(2j * np.pi * FREQUENCY / RATE))
    exact = _exact_amplitude(torque[-WINDOW:], 2 * np.pi * FREQUENCY / RATE)
    ours = long_trace[0].torque_amplitude_nm[-1]
    assert abs(plain - exact) > 10 * abs(ours - exact)


def test_a_huge_sample_is_forgotten():
    """One wild sample costs the plain recursion its digits for good; here they are back within two windows."""
    time = np.arange(6 * WINDOW) / RATE
    speed = np.cos(2 * np.pi * FREQUENCY * time + 0.7)
    spoilt = speed.copy()
    spoilt[WINDOW + 10] = 1e15
    plain = _plain_recursion(spoilt, WINDOW, np.exp(2j * np.pi * FREQUENCY / RATE))
    assert abs(plain - 1) > 1e-4
    found = OnlineEstimator(MACHINE, RATE, FREQUENCY).block(40 * speed, spoilt).speed_amplitude_rad_s
    np.testing.assert_allclose(found[3 * WINDOW :], 1.0, rtol=1e-13)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_lost_sample_silences_one_window(bad):
    time = np.arange(4 * WINDOW) / RATE
    torque = np.cos(2 * np.pi * FREQUENCY * time)
    clean = OnlineEstimator(MACHINE, RATE, FREQUENCY).block(torque, torque).inertia_kgm2
    spoilt = torque.copy()
    spoilt[WINDOW + 50] = bad
    found = OnlineEstimator(MACHINE, RATE, FREQUENCY).block(spoilt, torque).inertia_kgm2
    silent = slice(WINDOW + 50, 2 * WINDOW + 50)
    assert np.all(np.isnan(found[silent]))
    after = slice(silent.stop, None)
    np.testing.assert_allclose(found[after], clean[after], rtol=1e-9)


def test_a_motor_at_rest_has_no_inertia():
    trace = OnlineEstimator(MACHINE, RATE, FREQUENCY).block(np.ones(400), np.zeros(400))
    assert np.all(np.isnan(trace.inertia_kgm2))


# --------------------------------------------------------------------------------------- memory and bad input


def _allocates(function, *signature):
    """Whether the compiled code calls numba's allocator. Compiled afresh: what comes from a cache cannot be read."""
    fresh = njit(error_model="numpy")(function)
    fresh.compile(signature)
    (code,) = fresh.inspect_llvm().values()
    assert f"{function.__name__}" in code
    return "NRT_Allocate" in code or "NRT_MemInfo_alloc" in code


def _copies(values):
    return values.copy().sum()


def test_the_compiled_step_allocates_nothing():
    online = OnlineEstimator(MACHINE, RATE, FREQUENCY)
    arrays = (online._turn, online._model, online._ring, online._sums, online._place)
    assert not _allocates(push_sample.py_func, *(typeof(a) for a in arrays), float64, float64)
    assert _allocates(_copies, typeof(online._ring))


def test_pushing_keeps_no_memory():
    online = OnlineEstimator(MACHINE, RATE, FREQUENCY)
    values = np.random.default_rng(0).normal(size=(20_000, 2)).tolist()
    for torque, speed in values:
        online.push(torque, speed)
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for torque, speed in values:
            online.push(torque, speed)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 1.0 * len(values), (
        "less than a byte a sample: the interpreter's own, now and then"
    )
    assert online.memory_bytes < 60 * WINDOW


def test_bad_input_is_named():
    with pytest.raises(InputError, match="samples per period"):
        OnlineEstimator(MACHINE, 300.0, 50.0)
    with pytest.raises(InputError, match="sampling rate"):
        OnlineEstimator(MACHINE, math.nan, 50.0)
    online = OnlineEstimator(MACHINE, RATE, FREQUENCY)
    with pytest.raises(InputError, match="3 torques for 2 speeds"):
        online.block(np.zeros(3), np.zeros(2))
    with pytest.raises(InputError, match="2 reference samples for 3 of torque"):
        online.block(np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(2))
