"""What a fitted response is: numbers with intervals, and the words for what the band did not show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schwung.drivetrain import Coupling, InertiaTable, Machine
from schwung.errors import InputError
from schwung.estimation.bode_model import mobility
from schwung.estimation.response import BAND_SHARE, ComplexArray, Response
from schwung.motion import Array

#: Half-width of the 95 % interval in standard deviations.
_Z95 = 1.96
#: A number whose standard deviation exceeds this share of it is called not determined.
UNDETERMINED = 0.25
#: χ² per degree of freedom above which the model is said not to reach the noise.
_POOR_CHI2 = 4.0


@dataclass(frozen=True)
class Fitted:
    """A fitted number and its standard deviation, in the unit of the field that holds it."""

    value: float
    std: float

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval."""
        return _Z95 * self.std

    @property
    def ci95(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.value - self.half_width, self.value + self.half_width

    @property
    def determined(self) -> bool:
        """The standard deviation is a small part of the value."""
        return bool(self.std <= UNDETERMINED * abs(self.value))

    def to_json(self) -> dict[str, Any]:
        """Value, standard deviation, interval."""
        return {"value": self.value, "std": self.std, "ci95": list(self.ci95), "determined": self.determined}


@dataclass(frozen=True)
class AngleFit:
    """One angle: J_l (kg·m²), anti-resonance and resonance (Hz; None where the coupling did not show)."""

    position_rad: float
    inertia: Fitted
    anti_resonance: Fitted | None
    resonance: Fitted | None


@dataclass(frozen=True, eq=False)
class BodeFit:
    """Two masses as fitted; SI units. `coupled` False: nothing in the band needs a coupling, J_r is as believed.

    `corrected`: the measured points with delay and the images of a held injection taken out by the model.
    """

    coupled: bool
    rotor: Fitted | None
    stiffness: Fitted | None
    damping: Fitted | None
    rotor_friction: Fitted
    load_friction: Fitted
    delay: Fitted
    angles: tuple[AngleFit, ...]
    chi2: float
    responses: tuple[Response, ...]
    corrected: tuple[ComplexArray, ...]
    ambiguous: bool = False  # another machine fits nearly as well; the intervals reach to it
    believed_rotor_kgm2: float = 0.0  # what was taken off the sum where nothing showed a coupling
    notes: tuple[str, ...] = ()

    @property
    def inertia_range_kgm2(self) -> tuple[float, float]:
        """Smallest and largest fitted J_l."""
        values = [angle.inertia.value for angle in self.angles]
        return min(values), max(values)

    def response_at(self, number: int, frequency_hz: Array) -> ComplexArray:
        """The fitted speed over torque of one angle (rad/s per N·m), without the reporting delay, (n,)."""
        s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
        p = {"rotor_friction": self.rotor_friction.value, "load_friction": self.load_friction.value}
        if self.rotor is not None and self.stiffness is not None and self.damping is not None:
            p |= {
                "rotor": self.rotor.value,
                "stiffness": self.stiffness.value,
                "damping": self.damping.value,
            }
        else:
            p |= {"rotor": self.believed_rotor_kgm2, "stiffness": np.inf, "damping": 0.0}
        return mobility(p, self.angles[number].inertia.value, s)

    def machine(self, believed: Machine) -> Machine:
        """The believed machine with what was determined in place of what was believed; frictions stay as believed.

        At standstill dry friction passes for viscous, many times what is felt in motion. Several angles make an
        inertia table, one angle a number. Raises InputError where an inertia came out negative.
        """
        if self.inertia_range_kgm2[0] <= 0:
            raise InputError(
                "response",
                "gives a load inertia that is not positive",
                "Correct motor.inertia, or the units of torque and speed.",
            )
        motor, coupling = believed.motor, believed.coupling
        if self.rotor is not None and self.stiffness is not None and self.damping is not None:
            if self.rotor.determined:
                motor = motor.model_copy(update={"inertia_kgm2": self.rotor.value})
            if self.stiffness.determined:
                damped = self.damping.determined or coupling is None
                coupling = Coupling(
                    stiffness_nm_rad=self.stiffness.value,
                    damping_nms=self.damping.value if damped or coupling is None else coupling.damping_nms,
                )
        load = believed.load.model_copy(update=self._load())
        return believed.model_copy(update={"motor": motor, "coupling": coupling, "load": load})

    def _load(self) -> dict[str, Any]:
        position = np.array([angle.position_rad for angle in self.angles])
        inertia = np.array([angle.inertia.value for angle in self.angles])
        std = np.array([angle.inertia.std for angle in self.angles])
        if position.size == 1:
            return {"inertia_kgm2": float(inertia[0]), "inertia_table": None}
        return {"inertia_kgm2": None, "inertia_table": InertiaTable(position, inertia, std)}

    def to_json(self) -> dict[str, Any]:
        """For machines; frequencies in Hz, everything else SI."""
        shared = {
            "motor_inertia_kgm2": self.rotor,
            "stiffness_nm_rad": self.stiffness,
            "damping_nms": self.damping,
            "motor_friction_nms": self.rotor_friction,
            "load_friction_nms": self.load_friction,
            "delay_s": self.delay,
        }
        return {
            "coupled": self.coupled,
            "parameters": {name: fitted.to_json() for name, fitted in shared.items() if fitted is not None},
            "angles": [
                {
                    "position_rad": angle.position_rad,
                    "inertia_kgm2": angle.inertia.to_json(),
                    "anti_resonance_hz": angle.anti_resonance and angle.anti_resonance.to_json(),
                    "resonance_hz": angle.resonance and angle.resonance.to_json(),
                }
                for angle in self.angles
            ],
            "ambiguous": self.ambiguous,
            "chi2_per_degree_of_freedom": self.chi2,
            "responses": [_points(response) for response in self.responses],
            "notes": list(self.notes),
        }


def _points(response: Response) -> dict[str, Any]:
    return {
        "position_rad": response.position_rad,
        "frequency_hz": response.frequency_hz.tolist(),
        "magnitude": np.abs(response.response).tolist(),
        "phase_rad": np.angle(response.response).tolist(),
        "std": response.std.tolist(),
        "coherence": response.coherence.tolist(),
    }


def worded(fit: BodeFit) -> BodeFit:
    """The fit with its notes: what the band did not show, what the model does not reach."""
    return replace(fit, notes=tuple(_notes(fit)))


def _notes(fit: BodeFit) -> list[str]:
    notes = []
    top = max(float(r.frequency_hz[r.used].max()) for r in fit.responses)
    rate = fit.responses[0].sample_rate_hz
    reach = f"{top:.0f} Hz, the highest measured frequency (at {rate:g} Hz at most {BAND_SHARE * rate:g} Hz)"
    left_out = sum(int(np.sum(~r.used)) for r in fit.responses)
    if left_out:
        notes.append(
            f"{left_out} points were left out: coherence too low, or too near half the sampling rate"
        )
    if not fit.coupled:
        notes.append(
            f"up to {reach}, motor and load move as one: stiffness, damping and motor inertia cannot be determined; "
            "the load inertia is what is left of the sum after the believed motor inertia"
        )
    else:
        beyond = [a for a in fit.angles if a.resonance is not None and a.resonance.value > top]
        if beyond and beyond[0].resonance is not None:
            notes.append(
                f"the resonance, near {beyond[0].resonance.value:.0f} Hz, lies above {reach}: motor inertia and "
                "stiffness rest upon the slope below it, and so do their intervals"
            )
        for name, fitted in (
            ("motor inertia", fit.rotor), ("stiffness", fit.stiffness), ("damping", fit.damping),
        ):  # fmt: skip
            if fitted is not None and not fitted.determined:
                notes.append(
                    f"{name} is not determined by this recording: ±{fitted.half_width:.2g} of {fitted.value:.3g}"
                )
    if fit.ambiguous:
        notes.append(
            "another machine fits nearly as well, and the intervals reach to it: measure at a higher rate, or up to "
            "higher frequencies"
        )
    for name, fitted in (("motor", fit.rotor_friction), ("load", fit.load_friction)):
        if fitted.determined:
            notes.append(
                f"friction of the {name}, {fitted.value:.2g} ± {fitted.half_width:.1g} N·m·s/rad, is that of this "
                "small vibration; dry friction is in it, and the machine file keeps what it has"
            )
        else:
            most = max(fitted.ci95[1], 0)
            notes.append(f"viscous friction of the {name} is not determined: below {most:.2g} N·m·s/rad")
    if fit.chi2 > _POOR_CHI2:
        notes.append(
            f"the fit misses the points by {np.sqrt(fit.chi2):.1f} times their spread: friction, play or a further "
            "compliance is not in the model; the intervals are widened by as much"
        )
    return notes
