"""A part of the load that sloshes slower than the motions take, and counts as the load's in the belief."""

from dataclasses import replace

import numpy as np
import pytest
from integrated import RATE_HZ, sampled
from scipy.integrate import solve_ivp

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain.weighing.weigh import weigh
from schwung.innovations.likelihood import Noise
from schwung.motion import Array, Excitation, Motion
from schwung.session.model import Run, Session

ROTOR, LOAD, STIFFNESS, DAMPING, VISCOUS = 1e-3, 1.76e-3, 400.0, 0.05, 2e-3
#: Four times a second, for half a second and more.
FURTHER, HZ, RATIO = 2.4e-4, 4.0, 0.03
MACHINE = Machine(
    name="a tank",
    motor=Motor(inertia_kgm2=ROTOR, viscous_friction_nms=VISCOUS, peak_torque_nm=5.0),
    coupling=Coupling(stiffness_nm_rad=STIFFNESS, damping_nms=DAMPING),
    load=Load(inertia_kgm2=LOAD + FURTHER, viscous_friction_nms=0.0),
)
NOISE = Noise(torque_nm=5e-3, speed_rad_s=0.02, position_rad=2e-6)
BEGINS_S, LASTS_S = 0.1, 0.9


def torque(time: Array, distance: float, duration: float, sine: Excitation | None) -> Array:
    """So far within such a time, but for friction."""
    share = np.clip((time - BEGINS_S) / duration, 0.0, 1.0)
    size = 2 * np.pi * distance * (ROTOR + LOAD + FURTHER) / duration**2
    return np.asarray(size * np.sin(2 * np.pi * share) + (0.0 if sine is None else sine.torque(time)))


def run_of(number: int, distance: float, duration: float, hertz: float | None) -> Run:
    sine = None
    if hertz is not None:
        sine = Excitation(frequency_hz=hertz, amplitude_nm=0.35, phase_rad=0.0, ramp_s=0.04, end_s=LASTS_S)

    def rates(at: float, state: Array) -> list[float]:
        turned, speed, load_turned, load_speed, last_turned, last_speed = state
        carried = STIFFNESS * (turned - load_turned) + DAMPING * (speed - load_speed)
        rate = 2 * np.pi * HZ
        pulled = rate**2 * (load_turned - last_turned) + 2 * RATIO * rate * (load_speed - last_speed)
        pushed = float(torque(np.array([at]), distance, duration, sine)[0])
        load = (carried - FURTHER * pulled) / LOAD
        return [speed, (pushed - VISCOUS * speed - carried) / ROTOR, load_speed, load, last_speed, pulled]

    time = np.arange(round(LASTS_S * RATE_HZ)) / RATE_HZ
    moved = solve_ivp(rates, (0, time[-1]), np.zeros(6), "RK45", time, max_step=5e-4, rtol=1e-8, atol=1e-10).y
    motion = Motion(kind="poly5", distance_rad=distance, duration_s=duration, start_time_s=BEGINS_S)
    found = sampled(number, time, moved, torque(time, distance, duration, sine), NOISE)
    return replace(found, role="reference" if sine is None else "excited", motion=motion, excitation=sine)


@pytest.mark.long
def test_what_sloshes_is_a_further_mass_beside_a_lighter_load() -> None:
    """A further mass that the speed stiffens came to its end, where it is one that it does not, and nobody asked for
    that; of motor and load, what promised more at first was kept; and what swings stood for dry friction, which leaves
    open where the shaft rests: nothing was told, of twenty times the noise."""
    motions = ((3.1, 0.25, None), (3.1, 0.25, 45.0), (3.1, 0.45, None), (3.1, 0.45, 95.0), (1.2, 0.15, None))
    runs = tuple(run_of(repeat, *motion) for repeat in range(2) for motion in motions)
    found = weigh(Session(runs, created="2026-01-01T00:00:00+00:00", source="a tank"), MACHINE)
    assert {one.name for one in found.names if one.probability > 0.5} == {"extra_compliance", "load_inertia"}
    told = {one.name: one.parameters for one in found.names}
    assert told["extra_compliance"]["inertia_kgm2"].value == pytest.approx(FURTHER, rel=0.02)
    assert told["load_inertia"]["delta_kgm2"].value == pytest.approx(-FURTHER, rel=0.02)
