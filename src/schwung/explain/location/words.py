"""One sentence per located mismatch, in the units of the axis."""

from __future__ import annotations

from schwung.explain.values import Coordinate, Model, Signal
from schwung.session.model import Axis

_UNITS: dict[Coordinate, tuple[str, str]] = {
    "position": ("rad", "m"),
    "speed": ("rad/s", "m/s"),
    "direction": ("", ""),
    "acceleration": ("rad/s²", "m/s²"),
    "torque": ("N·m", "N"),
    "time_in_motion": ("s", "s"),
    "frequency": ("Hz", "Hz"),
    "run": ("", ""),
}
_NAMES: dict[Coordinate, str] = {
    "position": "position",
    "speed": "speed",
    "direction": "the direction of motion",
    "acceleration": "acceleration",
    "torque": "torque",
    "time_in_motion": "the time in the motion",
    "frequency": "a fixed frequency",
    "run": "the run's number",
}


def unit_of(coordinate: Coordinate, axis: Axis) -> str:
    """The coordinate's unit; empty for direction and run."""
    return _UNITS[coordinate][axis == "linear"]


def sentence(
    coordinate: Coordinate, interval: tuple[float, float], visited: tuple[float, float], share: float, axis: Axis,
    twin: Coordinate | None = None, each_turn: bool = False, of: Signal = "torque", by: Model = "the belief",
) -> str:  # fmt: skip
    """What a drive engineer reads; `twin`: what this one cannot be told from; `each_turn`: the place comes back; `of`:
    what is missed; `by`: by which model."""
    lo, hi = interval
    unit = unit_of(coordinate, axis)
    part = f"{100 * share:.0f} % of what {by} misses"
    if of == "speed":
        part += " of the reported speed"
    force = "force" if axis == "linear" and coordinate == "torque" else _NAMES[coordinate]
    everywhere = hi - lo >= 0.98 * (visited[1] - visited[0])
    if coordinate == "direction":
        where = (
            "in both directions" if lo < hi else f"in the {'positive' if lo > 0 else 'negative'} direction"
        )
        text = f"{where[0].upper()}{where[1:]}, {part} is constant" + (
            ", or changes with the direction of motion alone" if lo < hi else ""
        )
    elif coordinate == "frequency":
        text = f"Near {0.5 * (lo + hi):.4g} Hz, {part} is a vibration of fixed frequency"
    elif coordinate == "run":
        text = f"From run {lo:.0f} to run {hi:.0f}, {part} changes with the run's number"
    elif coordinate == "time_in_motion" and not everywhere:
        text = f"Between {lo:.4g} and {hi:.4g} s after the start, {part}"
    elif everywhere:
        text = f"Over the whole range of {force}, {part} follows from {force}"
    else:
        text = f"Between {lo:.4g} and {hi:.4g} {unit} of {force}, {part}"
    if each_turn:
        text += ", again in every turn"
    if twin is not None:
        text += f"; this session cannot tell that from {_NAMES[twin]}"
    return text + "."
