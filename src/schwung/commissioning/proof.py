"""What a small motion with an injected sine proves of signs and units, by relations that no unit alone can fulfil.

Phasors at the injected frequency, as the drive reports them: position P, speed W, torque T, and O, what was injected.
With a wrong unit or sign each is off by a factor. What the machine itself relates:

- W = jω P. Position counts and rpm come from different objects: gear and encoder.
- T = a O − b K P, where K = K_ps (1 + 1/(jω T_n)) (K_pp + jω) is what the cascade answers to the motion (method.md
  (2), (3); K of the gains in [control]). Two real factors from one complex equation: a is the sign and the scale of
  the torque that comes back against the one sent, b that of torque over position against the gains. No mass is in it.
- T = −ω² J P for what moves, J = Re(1/(jω G)), G the believed machine's response: no less than the rotor, no more than
  rotor and INERTIA_FACTOR times the believed load. Dry friction is in phase with the speed and drops out of the real
  part; so does gravity, which has no part at this frequency.

A factor of the rated torque is one of T and O: it is in b and J, not in a. A factor of position is in W, b and J.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schwung.commissioning.evidence import Evidence, Phasor
from schwung.commissioning.plan import believed_inertia_range
from schwung.drivetrain import Machine
from schwung.drivetrain.response import torque_to_speed

#: The believed load inertia may be too small by this factor; the rotor's is from its data sheet, to INERTIA_MARGIN.
INERTIA_FACTOR, INERTIA_MARGIN = 3.0, 1.25
#: What is compared may be off by this factor: speed and position, torque in and out, torque and gains.
SPEED_MARGIN, TORQUE_MARGIN, GAIN_MARGIN = 1.3, 1.5, 1.6
#: A phasor or a factor counts where it is this many of its standard deviations high.
SIGNIFICANT = 4.0
#: Friction reigns where the torque's part in phase with the speed is larger than this share of that with acceleration.
INERTIAL_SHARE = 0.5
#: Ends between which b may lie and still be told, one over the other.
MOST_SPREAD = 3.0
#: Sine of the angle between injection and the cascade's answer from which both can be told apart.
INDEPENDENT = 0.2
#: The cascade hardly answers where its torque is below this share of the injected one.
HARDLY = 0.02

Outcome = Literal["proven", "wrong", "unclear"]
_INERTIA = "torque over acceleration"


@dataclass(frozen=True)
class Belief:
    """The machine, with its gains and a load inertia, and the injected frequency (Hz)."""

    machine: Machine
    frequency_hz: float


@dataclass(frozen=True)
class Finding:
    """One relation: whether it holds, by which factor it does not, and that in words."""

    name: str
    outcome: Outcome
    factor: float
    text: str = ""
    remedy: str = ""


@dataclass(frozen=True)
class Proof:
    """What a stage has shown."""

    findings: tuple[Finding, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def wrong(self) -> Finding | None:
        """The first relation that does not hold."""
        return next((finding for finding in self.findings if finding.outcome == "wrong"), None)

    @property
    def proven(self) -> bool:
        """Every relation holds, as far as it can be told."""
        return self.wrong is None and not self.unclear

    @property
    def unclear(self) -> tuple[str, ...]:
        """Relations that could not be told, the speed's apart: where it is too coarse, that of the position is used."""
        return tuple(finding.name for finding in self.findings[1:] if finding.outcome == "unclear")


def judge(found: Evidence, belief: Belief, *, last: bool) -> Proof:
    """Hold a stage against what is believed. Before the `last`, only what friction and play cannot feign is wrong."""
    answer = _answer(found, belief)
    inertia, note = _inertia_finding(found, belief, answer, last)
    speed, torque = _speed_finding(found), _torque_finding(answer)
    if torque.outcome == "wrong" and torque.factor < 0 and inertia.outcome == "wrong" and inertia.factor > 0:
        torque = Finding(torque.name, "unclear", torque.factor)  # a large b leaves nothing to tell a from
    if torque.outcome == "unclear" and inertia.outcome == "proven" and answer is not None and answer.lasting:
        torque = Finding(torque.name, "proven", torque.factor)
        note = (
            note
            or "injected torque and the cascade's answer cannot be told apart: is [control] that of the drive?"
        )
    if inertia.outcome == "proven" and math.isnan(inertia.factor):  # the gains had nothing to say
        low, high = believed_range(belief)
        note = note or (
            f"torque against position is proven no better than that {low:.2g} to {high:.2g} kg·m² move: by the gains "
            "it could not be told, as a faster --rate may"
        )
    coarse = "the speed (606C) is too coarse for its unit to be proven" if speed.outcome == "unclear" else ""
    return Proof((speed, torque, inertia), tuple(filter(None, (note, coarse))))


def _turning(found: Evidence) -> float:
    return 2 * math.pi * found.frequency_hz


def _speed_finding(found: Evidence) -> Finding:
    """W = jω P where both are clean sines, else the mean speed of the strokes."""
    name = "speed over position"
    if found.speed is None:
        return Finding(name, "proven", 1.0)  # it is derived from it
    if found.position.clean and found.speed.clean:
        ratio = found.speed.value / (1j * _turning(found) * found.position.value)
        factor = math.copysign(abs(ratio), ratio.real)
        slack = SIGNIFICANT * abs(ratio) * math.hypot(found.position.share, found.speed.share)
    elif found.travel_rad_s > 0:
        factor = found.travel_told_rad_s / found.travel_rad_s
        slack = found.travel_std_rad_s / found.travel_rad_s
    else:
        return Finding(name, "unclear", math.nan)
    remedy = "Compare 60A9, 608F and 6091 in the drive with the units that the profile gives position and speed (606C)."
    if factor < -slack:
        return Finding(
            name, "wrong", factor, "the speed (606C) has the opposite sign of what the position does", remedy
        )
    if factor - slack > SPEED_MARGIN or factor + slack < 1 / SPEED_MARGIN:
        return Finding(
            name, "wrong", factor, f"the speed (606C) is {_times(abs(factor))} what the position does", remedy
        )
    sure = slack < 0.5 and 1 / SPEED_MARGIN < factor < SPEED_MARGIN
    return Finding(name, "proven" if sure else "unclear", factor)


def cascade(machine: Machine, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
    """K: torque that the cascade takes back per position, N·m/rad, in the shape of the frequencies.

    Raises InputError where the machine has no [control].
    """
    control, s = machine.required_control(), 2j * np.pi * np.asarray(frequency_hz, dtype=float)
    integral = 1 + 1 / (control.speed_integral_time_s * s)
    return np.asarray(control.speed_gain_nms * integral * (control.position_gain_per_s + s))


@dataclass(frozen=True)
class _Answer:
    """a and b of T = a O − b K P, as if the torque were told on time; and between which ends they lie where it may be
    late or early by `lag_s`. b is NaN where the cascade answers too little to tell."""

    a: float
    a_ends: tuple[float, float]
    b_ends: tuple[float, float]
    a_std: float
    acting: Phasor  # the torque that acts, held values seen to
    sure: bool = True  # a does not rest upon b being as the gains say
    noisy: bool = False  # with less noise, b could be told

    @property
    def lasting(self) -> bool:
        """No further stage would tell a better; its sign is right whatever b is."""
        return not self.sure and not self.noisy and self.a_ends[0] > SIGNIFICANT * self.a_std

    @property
    def b(self) -> float:
        """Torque over position against the gains; NaN where it is not told."""
        low, high = self.b_ends
        return math.copysign(math.sqrt(low * high), low) if low * high > 0 else math.nan


def _answer(found: Evidence, belief: Belief) -> _Answer | None:
    """T = a O − b K P, solved for the real a and b; None where nobody knows the phase of what was injected."""
    sent, acting, torque = found.added, found.added_acting, found.torque
    if sent is None or acting is None:
        return None
    gain = complex(cascade(belief.machine, found.frequency_hz))
    answer = -gain * found.position.value
    noise = math.hypot(torque.std, abs(gain) * found.position.std)
    late = [torque.value * np.exp(1j * share * _turning(found) * found.lag_s) for share in (0.0, -1.0, 1.0)]
    matrix = np.array([[sent.real, answer.real], [sent.imag, answer.imag]])
    noisy = abs(answer) <= SIGNIFICANT * noise
    if not noisy and abs(np.linalg.det(matrix)) > INDEPENDENT * abs(sent) * abs(answer):
        inverse = np.linalg.inv(matrix)
        a_std, b_std = (float(x) for x in np.linalg.norm(inverse, axis=1) * noise)
        a, b = (inverse @ [[value.real for value in late], [value.imag for value in late]]).tolist()
        ends = min(b) - 2 * b_std, max(b) + 2 * b_std
        if ends[0] * ends[1] > 0 and max(map(abs, ends)) < MOST_SPREAD * min(map(abs, ends)):
            return _Answer(a[0], (min(a), max(a)), ends, a_std, torque.value + a[0] * (acting - sent))
        noisy = 4 * b_std > max(b) - min(b)
    # the cascade hardly answers, or in phase with the injection: as the gains say, give or take
    shares = (1.0, 1 / GAIN_MARGIN, GAIN_MARGIN)
    a = [float(((value - b * answer) / sent).real) for b in shares for value in late]
    return _Answer(
        a[0], (min(a), max(a)), (math.nan, math.nan), noise / abs(sent), torque.value + a[0] * (acting - sent),
        sure=abs(answer) < HARDLY * abs(sent), noisy=noisy,
    )  # fmt: skip


def _torque_finding(answer: _Answer | None) -> Finding:
    """a is the sign and scale of the torque that comes back against the one sent."""
    name = "injected torque"
    if answer is None:
        return Finding(name, "proven", math.nan)
    (low, high), slack = answer.a_ends, SIGNIFICANT * answer.a_std
    if answer.sure and high < -slack:
        return Finding(
            name, "wrong", answer.a, "the reported torque (6077) holds the injected one (60B2) with the opposite sign",
            "Give one of the two scales in the profile the other sign.",
        )  # fmt: skip
    if answer.sure and (low - slack > TORQUE_MARGIN or (high + slack < 1 / TORQUE_MARGIN and low > slack)):
        return Finding(
            name, "wrong", answer.a,
            f"the reported torque (6077) holds {_times(answer.a)} the torque that was injected (60B2)",
            "Are both in per mille of the rated torque (6076), or in the units that the profile gives them?",
        )  # fmt: skip
    sure = low > slack and 1 / TORQUE_MARGIN < answer.a < TORQUE_MARGIN
    return Finding(name, "proven" if sure else "unclear", answer.a)


def _inertia_finding(
    found: Evidence, belief: Belief, answer: _Answer | None, last: bool
) -> tuple[Finding, str]:
    """T = −ω² J P, and b where the gains tell it; and what is worth a note.

    The gains' answer holds with any friction and play. An inertia is too large without doubt only where the torque is
    in phase with the acceleration; friction, play and wind-up may feign one that is too small, until the `last` stage.
    """
    position, torque = found.position, found.torque
    unclear = Finding(_INERTIA, "unclear", math.nan), ""
    if max(position.share, torque.share) > 1 / SIGNIFICANT:
        return unclear
    acting = torque.value if answer is None else answer.acting
    apparent = -acting / (_turning(found) ** 2 * position.value)
    felt = _Felt(apparent, 1 + SIGNIFICANT * math.hypot(position.share, torque.share), believed_range(belief))
    by_gains, note = _by_gains(felt, answer)
    if position.clean and not (by_gains and by_gains.outcome == "proven" and felt.least <= 1):
        return _by_inertia(felt, by_gains, answer, last), note
    # with stick and slip no inertia can be told, but the gains' answer is what it is
    return (by_gains, note) if by_gains and by_gains.outcome == "proven" else unclear


def _by_inertia(felt: _Felt, by_gains: Finding | None, answer: _Answer | None, last: bool) -> Finding:
    """What the inertia says where the gains do not say that all is well."""
    if by_gains is not None and by_gains.outcome == "wrong":
        return by_gains
    untold = by_gains is not None or (answer is not None and answer.noisy)
    if felt.least > 1 and (felt.inertial or last):
        return felt.wrong(felt.least)
    if felt.most < 1 and last:
        return felt.wrong(felt.most)
    within = felt.least <= 1 <= felt.most and (last or not untold)
    return Finding(_INERTIA, "proven" if within else "unclear", math.nan)


@dataclass(frozen=True)
class _Felt:
    """The inertia that torque and position make, in phase with the acceleration (real) and with the speed."""

    apparent: complex
    spread: float
    believed: tuple[float, float]

    @property
    def least(self) -> float:
        """The smallest factor of torque over position that the belief allows."""
        return self.apparent.real / self.believed[1] / self.spread

    @property
    def most(self) -> float:
        """The largest."""
        return self.apparent.real / self.believed[0] * self.spread

    @property
    def inertial(self) -> bool:
        """The axis swings freely."""
        return abs(self.apparent.imag) <= INERTIAL_SHARE * self.apparent.real

    def wrong(self, factor: float) -> Finding:
        """Torque over position is off by a factor."""
        if self.apparent.real < 0:
            return Finding(
                _INERTIA, "wrong", min(factor, -factor),
                "the motion answers the torque (6077) in the opposite direction",
                "Do position and torque have the same sign in the profile? Look at 607E (polarity), too.",
            )  # fmt: skip
        low, high = self.believed
        return Finding(
            _INERTIA, "wrong", factor,
            f"the torque is {max(factor, 1 / factor):.2g} times {'more' if factor >= 1 else 'less'} than the motion "
            f"accounts for (an inertia of {self.apparent.real:.2g} kg·m², believed {low:.2g} to {high:.2g})",
            "Check the rated torque (6076) and the encoder's resolution and gear (608F, 6091) in drive and profile, "
            "then [motor], [load] and [control] of the machine file.",
        )  # fmt: skip


def _by_gains(felt: _Felt, answer: _Answer | None) -> tuple[Finding | None, str]:
    """What b says, unless the inertia rules that out; what is to be noted of the gains then."""
    if answer is None or math.isnan(answer.b):
        return None, ""
    b, (low, high) = answer.b, answer.b_ends
    if b < 0:
        return (felt.wrong(b), "") if felt.apparent.real < 0 else (None, "")
    if 1 / GAIN_MARGIN <= b <= GAIN_MARGIN:
        return Finding(_INERTIA, "proven", b), ""
    if low <= GAIN_MARGIN and high >= 1 / GAIN_MARGIN:
        return Finding(_INERTIA, "unclear", b), ""
    if felt.least / GAIN_MARGIN <= b <= felt.most * GAIN_MARGIN:
        return felt.wrong(b), ""
    return (
        None,
        f"the cascade answers {_times(b)} as strongly as the gains say: is [control] that of the drive?",
    )


def believed_range(belief: Belief) -> tuple[float, float]:
    """Smallest and largest inertia that the motor may feel at the injected frequency (kg·m²)."""
    machine = belief.machine
    _, largest = believed_inertia_range(machine)
    s = 2j * math.pi * belief.frequency_hz
    felt = 1 / (
        s * torque_to_speed(machine, np.array([largest, INERTIA_FACTOR * largest]), belief.frequency_hz)
    )
    high = max(float(np.max(felt.real)), machine.motor.inertia_kgm2)
    return machine.motor.inertia_kgm2 / INERTIA_MARGIN, high * INERTIA_MARGIN


def _times(factor: float) -> str:
    """A factor as people say it; the usual confusions by name."""
    usual = (
        (60.0, "60"),
        (2 * math.pi, "2π"),
        (60 / (2 * math.pi), "60/2π (rpm for rad/s)"),
        (1000.0, "1000"),
    )
    for known, words in usual:
        for value, text in ((known, f"{words} times"), (1 / known, f"1/{words} of")):
            if abs(factor / value - 1) < 0.1:
                return text
    return f"{factor:.3g} times"
