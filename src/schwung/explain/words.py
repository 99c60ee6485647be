"""The physics of an explanation in words: what each name means, what shows it, what tells two of them apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from schwung.session.model import Axis

#: What a term is drawn over. "run": over the number of the run, "wind_up": the coupling's characteristic.
View = Literal[
    "speed", "position", "torque", "torque_rate", "acceleration", "time", "frequency", "run", "wind_up"
]


@dataclass(frozen=True)
class Words:
    """One physics name: what people call it, what it is drawn over, and which motion shows it."""

    name: str
    view: View
    shown_by: str


_TWO_TIMES = "the same stroke at two clearly different motion times"
_BOTH_WAYS = "a stroke there and back"
_SINE = "runs with an injected sine, at two frequencies"
_BODE = "a frequency response at standstill (schwung bode)"

PHYSICS: dict[str, Words] = {
    "coulomb_friction": Words("dry friction", "speed", "a stroke there and back, at any speed"),
    "stribeck_friction": Words(
        "dry friction that falls with speed near standstill", "speed", "a stroke that creeps for a while"
    ),
    "asymmetric_friction": Words("dry friction that differs by direction", "speed", _BOTH_WAYS),
    "friction_over_angle": Words("dry friction that differs along the way", "position", _BOTH_WAYS),
    "viscous_drift": Words(
        "viscous friction that changes during the session", "run", "motions mixed over the session"
    ),
    "load_dependent_friction": Words(
        "friction by the torque that is carried, as of gears", "torque", _TWO_TIMES
    ),
    "load_side_friction": Words("dry friction behind the coupling", "speed", _BOTH_WAYS),
    "presliding_friction": Words(
        "friction that is a spring before it slides", "position", "a stroke there and back, from rest"
    ),
    "direction_dependent_load": Words("a load that differs by direction", "position", _BOTH_WAYS),
    "offset_drift": Words(
        "an offset that changes during the session", "run", "the same motion first and last"
    ),
    "torque_constant_fade": Words("a torque constant that falls as the motor heats", "torque", _TWO_TIMES),
    "torque_constant_drop": Words("a torque constant that falls with torque", "torque", _TWO_TIMES),
    "torque_ripple": Words("ripple in proportion to the torque", "position", _TWO_TIMES),
    "torque_filter": Words("a torque that is reported late", "torque_rate", _SINE),
    "inertia_profile": Words("a load inertia of another curve", "position", _TWO_TIMES),
    "viscous_friction": Words("viscous friction", "speed", _TWO_TIMES),
    "quadratic_drag": Words("drag that grows with the square of speed", "speed", _TWO_TIMES),
    "local_friction": Words("a tight spot", "position", "a stroke there and back over the spot"),
    "friction_drift": Words(
        "friction that changes during the session", "run", "the same motion first and last in the session"
    ),
    "load_torque": Words("a load that depends on position, such as gravity", "position", _BOTH_WAYS),
    "end_spring": Words("a stop or spring at the end of the stroke", "position", "a stroke into it and back"),
    "torque_offset": Words("a constant offset", "time", "a stroke there and back, with rests"),
    "load_event": Words(
        "a disturbance at one time in the motion", "time", "repeats of one motion, and another motion time"
    ),
    "periodic_disturbance": Words("a disturbance of fixed frequency", "frequency", _TWO_TIMES),
    "cogging": Words("cogging", "position", "a slow stroke over several teeth, at two motion times"),
    "torque_constant": Words(
        "a torque constant that is off", "torque", "motions of which some accelerate hard and some hardly"
    ),
    "torque_lag": Words("a torque that lags", "torque_rate", _SINE),
    "torque_saturation": Words(
        "a torque that is clipped early", "torque", "one motion that needs much and one that needs little"
    ),
    "measurement_delay": Words("a speed that is reported late", "torque_rate", _SINE),
    "encoder_eccentricity": Words(
        "an encoder that runs eccentrically", "position", "several turns, at two motion times"
    ),
    "encoder_harmonic": Words("an encoder that is off many times a turn", "position", _TWO_TIMES),
    "backlash": Words(
        "play in the coupling", "wind_up", "motions that reverse the coupling's torque, small and large"
    ),
    "coupling_stiffness": Words("a coupling of another stiffness", "wind_up", _BODE),
    "coupling_damping": Words("a coupling of another damping", "frequency", _BODE),
    "nonlinear_stiffness": Words(
        "a coupling that stiffens with wind-up", "wind_up", "injected sines of small and of large amplitude"
    ),
    "coupling_hysteresis": Words(
        "a coupling with hysteresis", "wind_up", "injected sines of small and of large amplitude"
    ),
    "stiffness_over_angle": Words(
        "a stiffness that differs along the way", "position", "a long stroke, with an injected sine"
    ),
    "kinematic_error": Words("a transmission that is off many times a turn", "position", _SINE),
    "extra_compliance": Words("a further flexible mass", "frequency", _BODE),
    "load_inertia": Words("a load inertia that is off", "acceleration", _TWO_TIMES),
    "motor_inertia": Words("a motor inertia that is off", "acceleration", _SINE),
    "inertia_profile_shift": Words("an inertia table out of place", "position", _TWO_TIMES),
}

#: On a linear axis these are called otherwise.
_LINEAR = (
    ("torque", "force"),
    ("inertia table", "mass table"),
    ("load inertia", "load mass"),
    ("motor inertia", "motor mass"),
    ("motor's own inertia", "motor's own mass"),
    ("motor's inertia", "motor's mass"),
    ("turns", "periods of the scale"),
    ("an encoder that runs eccentrically", "a scale with a periodic error"),
    ("an encoder that is off many times a turn", "a scale with an error of a short period"),
)

_SLOWER = "Drive the same stroke several times slower: "
_FASTER = "Drive the same stroke at two clearly different motion times: "
_RETURN = "Drive the stroke there and back: "
_INJECT = "Inject a sine at two frequencies: "
_UNCOUPLED = "Drive the motor alone, uncoupled: an encoder's error stays, a transmission's is gone."

#: What tells two names apart. In each pair the names are in alphabetical order.
_PAIRS: dict[tuple[str, str], str] = {
    ("coulomb_friction", "stribeck_friction"): _SLOWER + "only near standstill do the two differ.",
    ("coulomb_friction", "viscous_friction"): _FASTER + "dry friction stays, viscous friction follows speed.",
    ("asymmetric_friction", "coulomb_friction"): _RETURN + "only then do both directions show.",
    ("coulomb_friction", "torque_offset"): _RETURN + "friction changes its sign, an offset does not.",
    ("asymmetric_friction", "torque_offset"): "Let the axis rest within the stroke, reached from both sides: "
    "the motor holds an offset at rest, friction it does not have to hold.",
    ("asymmetric_friction", "load_torque"): "Drive a longer stroke: a load changes along it, friction does not.",
    ("quadratic_drag", "viscous_friction"): _FASTER + "drag grows with the square of the speed.",
    ("coulomb_friction", "quadratic_drag"): _FASTER + "dry friction stays, drag grows.",
    ("quadratic_drag", "stribeck_friction"): _SLOWER + "drag is gone there, Stribeck friction is greatest.",
    ("coulomb_friction", "local_friction"): "Drive a longer stroke: a tight spot has ends.",
    ("load_torque", "local_friction"): _RETURN + "friction changes its sign, a load does not.",
    ("cogging", "local_friction"): _RETURN + "friction changes its sign, cogging does not.",
    ("load_event", "local_friction"): _FASTER + "a tight spot stays at its place, an event at its time.",
    ("load_event", "load_torque"): _FASTER + "a load stays at its place, an event at its time.",
    ("cogging", "load_event"): _FASTER + "cogging stays at its place, an event at its time.",
    ("load_torque", "torque_offset"): "Drive a longer stroke: a load changes along it, an offset does not.",
    ("end_spring", "load_torque"): "Drive a stroke that begins clear of the end: a spring begins at its place, and "
    "pushes in proportion from there on.",
    ("cogging", "load_torque"): "Drive a longer stroke: cogging repeats along it.",
    ("cogging", "periodic_disturbance"): _FASTER + "the frequency of cogging follows speed.",
    ("encoder_eccentricity", "periodic_disturbance"): _FASTER + "the encoder's error follows the angle.",
    ("cogging", "encoder_eccentricity"): _FASTER + "what an encoder's error costs grows with the square of speed, "
    "cogging stays.",
    ("cogging", "encoder_harmonic"): _FASTER + "what an encoder's error costs grows with the square of speed, "
    "cogging stays.",
    ("encoder_harmonic", "kinematic_error"): _UNCOUPLED,
    ("encoder_eccentricity", "kinematic_error"): _UNCOUPLED,
    ("encoder_eccentricity", "load_torque"): _FASTER + "what an encoder's error costs grows with the square of "
    "speed, a load stays.",
    ("inertia_profile_shift", "load_torque"): _FASTER + "inertia's torque grows with the square of speed, a load "
    "stays.",
    ("inertia_profile_shift", "load_inertia"): "Drive over the whole of the inertia table: a shift changes its sign "
    "where the table turns.",
    ("load_inertia", "torque_constant"): "Inject a sine above the resonance: there the motor's own inertia answers "
    "alone, and only the torque constant can be off.",
    ("load_inertia", "motor_inertia"): "Inject a sine above the resonance: there the motor's own inertia answers "
    "alone.",
    ("motor_inertia", "torque_constant"): "Measure the frequency response at standstill (schwung bode): a torque "
    "constant scales all of it, the motor's inertia moves the resonance.",
    ("torque_constant", "torque_saturation"): _SLOWER + "nothing is clipped there, a factor remains.",
    ("load_inertia", "torque_saturation"): _SLOWER + "nothing is clipped there.",
    ("measurement_delay", "torque_lag"): _INJECT + "the phase of a delay grows with frequency, that of a lag levels "
    "off.",
    ("torque_lag", "viscous_friction"): _FASTER + "what a lag costs follows jerk, friction follows speed.",
    ("measurement_delay", "viscous_friction"): _FASTER + "what a delay costs follows jerk, friction follows speed.",
    ("coupling_damping", "torque_lag"): "Measure the frequency response at standstill (schwung bode): damping acts "
    "at the resonance, a lag everywhere.",
    ("coupling_damping", "measurement_delay"): "Measure the frequency response at standstill (schwung bode): damping "
    "acts at the resonance, a delay everywhere.",
    ("coupling_stiffness", "load_inertia"): "Measure the frequency response at standstill (schwung bode): stiffness "
    "moves the resonance and leaves low frequencies alone.",
    ("coupling_stiffness", "nonlinear_stiffness"): "Inject a small and a large sine: only a nonlinear coupling "
    "answers them differently.",
    ("backlash", "coupling_stiffness"): "Inject a sine while the coupling is loaded, and once where its torque "
    "reverses: play shows in the second alone.",
    ("backlash", "nonlinear_stiffness"): "Inject a small and a large sine: play softens small ones, cubic stiffness "
    "hardens large ones.",
    ("coupling_stiffness", "extra_compliance"): "Measure the frequency response over a wide band (schwung bode): a "
    "further mass has a resonance of its own.",
    ("coupling_damping", "extra_compliance"): "Measure the frequency response over a wide band (schwung bode): a "
    "further mass has a resonance of its own.",
    ("coupling_damping", "coupling_hysteresis"): _INJECT + "what damps grows with frequency, hysteresis does not.",
    ("coupling_hysteresis", "coupling_stiffness"): "Inject a small and a large sine: what yields is the softer the "
    "further it is wound up.",
    ("torque_constant", "torque_constant_fade"): "Play a motion many times at once, and again after a pause: what "
    "heats has cooled meanwhile.",
    ("coulomb_friction", "friction_drift"): "Repeat the first motion at the end of the session.",
    ("friction_drift", "viscous_friction"): "Mix the motion times over the session instead of sorting them.",
}  # fmt: skip


_UNITS = {
    "N·m·s²/rad²": "N·s²/m²", "N·m·s/rad": "N·s/m", "N·m/rad³": "N/m³", "N·m/rad": "N/m", "N·m": "N",
    "rad/s": "m/s", "rad": "m", "kg·m²": "kg", "1/rev": "1/m",
}  # fmt: skip


def unit_on(unit: str, axis: Axis) -> str:
    """A unit of a rotary axis as that of either."""
    return _UNITS.get(unit, unit) if axis == "linear" else unit


def words_of(physics: str, *, linear: bool = False) -> Words:
    """What a physics name is called and drawn over; a name that this version does not know, by itself."""
    found = PHYSICS.get(physics, Words(physics.replace("_", " "), "time", _TWO_TIMES))
    return Words(_on(linear, found.name), found.view, _on(linear, found.shown_by))


def told_apart_by(one: str, other: str, *, linear: bool = False) -> str:
    """One sentence: the motion that would separate two physics names that a session cannot tell apart."""
    first, second = sorted((one, other))
    sentence = _PAIRS.get((first, second))
    if sentence is None:
        shown = dict.fromkeys(words_of(name).shown_by for name in (one, other))
        sentence = f"Record {' and '.join(shown)}."
    return _on(linear, sentence)


def _on(linear: bool, text: str) -> str:
    if linear:
        for rotary, other in _LINEAR:
            text = text.replace(rotary, other)
    return text
