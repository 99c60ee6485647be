"""What `schwung bode` left in its folder, read again for commissioning: what to inject, and the fitted drive train."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from schwung.commissioning.commission import Wishes
from schwung.drivetrain import Coupling, Machine
from schwung.errors import InputError

BODE_FILE = "bode.json"
FORMAT, VERSION = "schwung-bode", 1
#: Taken in place of the machine file's where the standard deviation is a smaller share: data sheets are as good.
WELL_KNOWN = 0.05
#: A motion that differs by more than this share is another one than bode's proposal is for.
SAME_MOTION = 0.1


@dataclass(frozen=True)
class Injection:
    """What to inject and the error of J_l to expect; None: was not proposed."""

    frequency_hz: float | None = None
    amplitude_nm: float | None = None
    expected_error_kgm2: float | None = None


@dataclass(frozen=True)
class BodeResult:
    """The proposals, and of J_r, k and b what is known well, None where it is not; SI units."""

    path: Path
    single: Injection = Injection()
    in_phases: Injection = Injection()
    distance_rad: float | None = None  # the stroke that the proposal is for
    duration_s: float | None = None
    motor_inertia_kgm2: float | None = None
    stiffness_nm_rad: float | None = None
    damping_nms: float | None = None

    def machine(self, believed: Machine) -> Machine:
        """The believed machine with what is known well in place of what was believed."""
        motor, coupling = believed.motor, believed.coupling
        if self.motor_inertia_kgm2 is not None:
            motor = motor.model_copy(update={"inertia_kgm2": self.motor_inertia_kgm2})
        if self.stiffness_nm_rad is not None:
            damping = self.damping_nms
            if damping is None:
                damping = coupling.damping_nms if coupling is not None else 0.0
            coupling = Coupling(stiffness_nm_rad=self.stiffness_nm_rad, damping_nms=damping)
        return believed.model_copy(update={"motor": motor, "coupling": coupling})

    def wishes(self, wishes: Wishes) -> Wishes:
        """The wishes with the proposal in the gaps that they leave, and the reasons."""
        injection = self._injection(wishes)
        return replace(
            wishes,
            frequency_hz=wishes.frequency_hz or injection.frequency_hz,
            amplitude_nm=wishes.amplitude_nm or injection.amplitude_nm,
            because=(*wishes.because, *self._reasons(wishes)),
        )

    def _injection(self, wishes: Wishes) -> Injection:
        return self.single if wishes.phases == 1 else self.in_phases

    def _reasons(self, wishes: Wishes) -> Iterator[str]:
        taken, injection = [], self._injection(wishes)
        if injection.frequency_hz is not None and wishes.frequency_hz is None:
            taken.append(f"{injection.frequency_hz:g} Hz")
        if injection.amplitude_nm is not None and wishes.amplitude_nm is None:
            taken.append(f"{injection.amplitude_nm:.3g} N·m")
        if taken:
            expected = injection.expected_error_kgm2
            error = f", expected error {expected:.2g} kg·m²" if expected else ""
            yield f"injection of {' with '.join(taken)}: bode's proposal{self._stroke_text()}{error}"
            if not self._same_motion(wishes):
                yield (
                    "bode proposed for another motion than this one: `schwung bode --session` with this --distance and "
                    "--duration proposes anew, without moving"
                )
        fitted = [
            f"{name} {value:.4g} {unit}"
            for name, value, unit in (
                ("motor inertia", self.motor_inertia_kgm2, "kg·m²"),
                ("stiffness", self.stiffness_nm_rad, "N·m/rad"),
                ("damping", self.damping_nms, "N·m·s/rad"),
            )
            if value is not None
        ]
        if fitted:
            yield f"{', '.join(fitted)}: as bode fitted, in place of the machine file's"

    def _stroke_text(self) -> str:
        if self.distance_rad is None or self.duration_s is None:
            return ""
        return f" for {abs(self.distance_rad):.4g} rad in {1e3 * self.duration_s:g} ms"

    def _same_motion(self, wishes: Wishes) -> bool:
        if self.distance_rad is None or self.duration_s is None:
            return True  # it was made without one
        pairs = (
            (abs(self.distance_rad), abs(wishes.distance_rad)),
            (self.duration_s, wishes.duration_s),
        )
        return all(abs(one / other - 1) <= SAME_MOTION for one, other in pairs)


def read_bode(path: Path) -> BodeResult:
    """Read `bode.json`, or the one in a folder.

    Raises InputError where there is none, or it is not what `schwung bode` writes.
    """
    file = path / BODE_FILE if path.is_dir() else path
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(
            str(file), f"cannot be read: {reason}", "Give the folder that `schwung bode` wrote."
        ) from None
    except ValueError:
        raise _alien(file) from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise _alien(file)
    if document.get("version") != VERSION:
        raise InputError(
            str(file), f"has version {document.get('version')!r}", "Measure again with this Schwung."
        )
    parameters, proposal = document.get("parameters") or {}, document.get("proposal") or {}
    stroke: Any = proposal.get("stroke") or {} if isinstance(proposal, dict) else None
    phased: Any = proposal.get("in_phases") or {} if isinstance(proposal, dict) else None
    fitted = parameters.values() if isinstance(parameters, dict) else (None,)
    if not all(isinstance(part, dict) for part in (proposal, stroke, phased, *fitted)):
        raise _alien(file)

    def injection(place: str, values: Mapping[str, Any]) -> Injection:
        names = ("frequency_hz", "amplitude_nm", "expected_error_kgm2")
        return Injection(*(_positive(file, place, values, name) for name in names))

    def known(name: str) -> float | None:
        found = parameters.get(name, {})
        value, std = (_positive(file, f"parameters.{name}", found, key) for key in ("value", "std"))
        return value if value and std and std < WELL_KNOWN * value else None

    return BodeResult(
        path=file,
        single=injection("proposal", proposal),
        in_phases=injection("proposal.in_phases", phased),
        distance_rad=_number(file, "proposal.stroke", stroke, "distance_rad"),
        duration_s=_positive(file, "proposal.stroke", stroke, "duration_s"),
        motor_inertia_kgm2=known("motor_inertia_kgm2"),
        stiffness_nm_rad=known("stiffness_nm_rad"),
        damping_nms=known("damping_nms"),
    )


def _positive(file: Path, place: str, values: Mapping[str, Any], name: str) -> float | None:
    value = _number(file, place, values, name)
    if value is not None and not value > 0:
        raise InputError(
            f"{file}, {place}.{name}", f"is {value!r}, not above zero", "Let `schwung bode` write it."
        )
    return value


def _number(file: Path, place: str, values: Mapping[str, Any], name: str) -> float | None:
    value = values.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(
            f"{file}, {place}.{name}", f"is {value!r}, no number", "Let `schwung bode` write it."
        )
    return float(value)


def _alien(file: Path) -> InputError:
    return InputError(
        str(file),
        "is not what `schwung bode` writes",
        f"Give its folder or its {BODE_FILE}; older ones are written again by `schwung bode --session`.",
    )
