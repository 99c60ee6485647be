"""Machines that a simulated drive can move, with concealed physics: "two-mass" and "slider-crank"."""

from __future__ import annotations

from typing import Any, Protocol

from schwung_sim.errors import BenchError
from schwung_sim.plants.concealed import EFFECTS, Concealed, Sensor, parse_conceal
from schwung_sim.plants.profile import Array, Profile
from schwung_sim.plants.two_mass import TICK_S, TwoMassMachine, TwoMassPlant

__all__ = [
    "EFFECTS", "PLANTS", "TICK_S", "Concealed", "Plant", "Profile", "Sensor", "TwoMassMachine",
    "TwoMassPlant", "make_plant", "parse_conceal",
]  # fmt: skip

PLANTS = ("two-mass", "slider-crank")


class Plant(Protocol):
    """A machine with a motor; it starts at rest at motor angle 0 (load at 0, too)."""

    name: str
    sensor: Sensor

    @property
    def rotor_inertia_kgm2(self) -> float:
        """J_r (kg·m²)."""
        ...

    @property
    def motor_rad(self) -> float:
        """True motor angle (rad)."""
        ...

    def step(self, torque_nm: float) -> None:
        """Let one control tick (TICK_S) pass with this torque commanded."""
        ...

    def check(self) -> None:
        """Raise BenchError where the integration has diverged."""
        ...

    def begin_motion(self) -> None:
        """A motion starts now."""
        ...

    def true_inertia(self, position_rad: Array) -> Array:
        """J_l (kg·m²), (n,), at load angles (n,), as it really is."""
        ...


def make_plant(name: str, conceal: str | Concealed = "", seed: int = 0, **options: Any) -> Plant:
    """A plant by name; `conceal` in the syntax of concealed.py, `options` those of the plant's class.

    Raises BenchError for a plant or an effect that does not exist.
    """
    concealed = parse_conceal(conceal) if isinstance(conceal, str) else conceal
    if name == "two-mass":
        return TwoMassPlant(concealed=concealed, seed=seed, **options)
    if name == "slider-crank":
        try:
            from schwung_sim.plants.slider_crank import SliderCrankPlant
        except ImportError as error:
            raise BenchError(
                "plant slider-crank", "needs MuJoCo, not installed here", 'Run pip install "schwung[bench]".'
            ) from error
        return SliderCrankPlant(concealed=concealed, seed=seed, **options)
    raise BenchError("plant", f'there is none called "{name}"', f"There are {', '.join(PLANTS)}.")
