"""Which column is what, by what the quantities must satisfy: speed is the slope of position, torque gathers speed."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from schwung.motion import Array
from schwung.session.guess.prepared import Prepared

#: Speed is the slope of position, but for filters and noise: at least this correlation.
_IS_SLOPE = 0.97
#: A speed that hardly changes is told by its mean, too: so much correlation through the origin, and so much without it.
_IS_SLOPE_AT_ALL, _CHANGES_ALIKE = 0.99, 0.8
#: Columns that follow each other so closely are one quantity, twice: as demanded, and as measured.
_SAME = 0.99
#: Columns in exact proportion are the same signal in two units.
_PROPORTION = 1 - 1e-9
_SMOOTH = 0.02  # white noise of a position, as a share of its range
#: The share of what speed, friction and weight leave that acceleration has to explain before it tells the sign; else
#: work does, which a motor puts in on the whole.
SURE_GAIN = 0.3
_EXPLAINED = 0.3  # of a torque's variance, at the least, by a motion's own terms
_QUIETER = 2.0  # by so much less noise the demanded of two signals has
_LEAD_SAMPLES = 0.3

POSITION_WORDS = ("pos", "position", "angle", "winkel", "theta", "phi", "q", "lage", "weg", "enc", "encoder")
SPEED_WORDS = (
    "vel",
    "velocity",
    "speed",
    "omega",
    "dq",
    "qd",
    "drehzahl",
    "geschw",
    "geschwindigkeit",
    "rpm",
    "n",
)
TORQUE_WORDS = ("torque", "tau", "trq", "tq", "moment", "drehmoment", "force", "kraft", "m", "u")
CURRENT_WORDS = ("current", "curr", "strom", "iq", "i", "amp", "amps")
DEMAND_WORDS = (
    "set",
    "soll",
    "demand",
    "cmd",
    "command",
    "commanded",
    "ref",
    "reference",
    "des",
    "desired",
    "target",
)
_ACCELERATION_WORDS = ("acc", "accel", "acceleration", "ddq", "qdd", "beschl")


def words_of(name: str) -> list[str]:
    """The words in a column's name: `Axis1.ActPos_deg` has axis, act, pos, deg."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", re.sub(r"[\[(].*", "", name))
    return [word.lower() for word in re.findall(r"[A-Za-z]+", spaced)]


def sounds_like(name: str, words: tuple[str, ...]) -> bool:
    """Whether a name has one of these words, or begins with one of at least three letters."""
    own = words_of(name)
    return any(word in words or any(len(w) > 2 and word.startswith(w) for w in words) for word in own)


@dataclass(frozen=True)
class Pair:
    """A speed that is the slope of a position: speed = ratio times slope, by columns' places."""

    position: int
    speed: int
    ratio: float
    correlation: float


@dataclass(frozen=True)
class Torque:
    """A column that gathers the speed of a position: what of it the motion's own terms explain, and its sign."""

    column: int
    sign: float
    explained: float
    by_acceleration: float
    inertia: float  # in the column's unit per (position unit)/s²
    fitted: Array
    gathering: Array  # without what speed, friction and weight account for


@dataclass(frozen=True)
class Joint:
    """One axis in the file, by columns' places; `twins` are signals in exact proportion to the torque."""

    position: int
    demand: int | None
    demand_evidence: str
    speed: int | None
    ratio: float | None
    correlation: float
    torques: tuple[Torque, ...]
    speeds: tuple[Pair, ...]
    others: tuple[int, ...]
    twins: tuple[int, ...]


def find_joints(given: Prepared, fixed: dict[str, int]) -> list[Joint]:
    """Axes in the file, the one that explains most first. `fixed`: places that the user said, by quantity."""
    settled = slice(given.edge, -given.edge)
    slope, slow = given.slope[settled], given.slow[settled]
    correlation, through_origin = _correlation(slope, slow), _correlation(slope, slow, centred=False)
    told = (np.abs(through_origin) > _IS_SLOPE_AT_ALL) & (np.abs(correlation) > _CHANGES_ALIKE)
    correlation = np.where(told, through_origin, correlation)
    positions = [fixed["position"]] if "position" in fixed else _roots(given, correlation)
    groups = _together(given, positions)
    joints: list[Joint] = []
    for group in groups:
        actual, demand, why = _actual_and_demand(given, group)
        if "position_demand" in fixed:
            demand, why = fixed["position_demand"], "as you say"
        pairs = _speeds(given, actual, correlation, group, fixed)
        speed = pairs[0] if pairs else None
        taken = {actual, *group, *(pair.speed for pair in pairs), *([demand] if demand is not None else [])}
        torques = _torques(given, actual, taken, fixed)
        twins = tuple(
            k for k in range(len(given.columns))
            if torques and k != torques[0].column and abs(_like(given, k, torques[0].column)) > _PROPORTION
        )  # fmt: skip
        joints.append(
            Joint(
                position=actual,
                demand=demand,
                demand_evidence=why,
                speed=None if speed is None else speed.speed,
                ratio=None if speed is None else speed.ratio,
                correlation=0.0 if speed is None else speed.correlation,
                torques=tuple(each for each in torques if each.column not in twins),
                speeds=tuple(pairs),
                others=tuple(k for k in group if k not in (actual, demand)),
                twins=twins,
            )
        )
    found = [joint for joint in joints if joint.torques]
    return _each_torque_once(given, sorted(found, key=lambda joint: joint.position))


def _correlation(
    first: NDArray[np.float64], second: NDArray[np.float64], centred: bool = True
) -> NDArray[np.float64]:
    """Correlation of every column of the first with every one of the second, (columns, columns)."""
    a = first - first.mean(axis=0) if centred else first.copy()
    b = second - second.mean(axis=0) if centred else second.copy()
    a /= np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    b /= np.maximum(np.linalg.norm(b, axis=0), 1e-300)
    return np.asarray(a.T @ b)


def _roots(given: Prepared, correlation: NDArray[np.float64]) -> list[int]:
    """Columns that may be positions: smooth, with a slope among the others, and not the slope of another themselves;
    where there is none, smooth ones by name, else all smooth ones."""
    count = len(given.columns)
    span = np.ptp(given.raw, axis=0)
    smooth = [k for k in range(count) if given.noise[k] < _SMOOTH * span[k]]
    slopes = np.abs(correlation) > _IS_SLOPE
    np.fill_diagonal(slopes, False)
    with_slope = [k for k in smooth if slopes[k].any() and not slopes[smooth, k].any()]
    if with_slope:
        return with_slope
    named = [k for k in smooth if sounds_like(given.columns[k].name, POSITION_WORDS)]
    others = (*SPEED_WORDS, *TORQUE_WORDS, *CURRENT_WORDS, *_ACCELERATION_WORDS)
    return named or [k for k in smooth if not sounds_like(given.columns[k].name, others)] or smooth


def _together(given: Prepared, positions: list[int]) -> list[list[int]]:
    """Positions in groups of one quantity each."""
    groups: list[list[int]] = []
    for k in positions:
        for group in groups:
            span = np.ptp(given.slow[:, k]) / np.ptp(given.slow[:, group[0]])
            if _like(given, k, group[0]) > _SAME and 0.8 < span < 1.25:
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _like(given: Prepared, first: int, second: int) -> float:
    a, b = given.slow[:, first], given.slow[:, second]
    return float(np.corrcoef(a, b)[0, 1])


def lead_samples(early: Array, late: Array) -> float:
    """By how many samples the first signal (n,) leads the second: the shift that explains their difference best."""
    slope = np.gradient(late)
    return float(np.dot(early - late - np.mean(early - late), slope) / max(np.dot(slope, slope), 1e-300))


def _actual_and_demand(given: Prepared, group: list[int]) -> tuple[int, int | None, str]:
    """Of columns that are one quantity, the measured and the demanded one: the demand leads, or is smoother."""
    if len(group) == 1:
        return group[0], None, ""
    names = {k: sounds_like(given.columns[k].name, DEMAND_WORDS) for k in group}
    first, second = group[:2]
    demanded = [k for k in group if names[k]]
    if len(demanded) == 1 and len(group) > 2:
        first, second = demanded[0], next(k for k in group if k != demanded[0])
    lead = lead_samples(given.slow[:, first], given.slow[:, second]) / given.rate_hz
    sample = 1 / (given.clock.rate_hz if given.clock is not None else given.rate_hz)
    if abs(lead) > _LEAD_SAMPLES * sample:
        demand, actual = (first, second) if lead > 0 else (second, first)
        return actual, demand, f"leads {given.columns[actual].name} by {abs(lead) * 1e3:.3g} ms"
    noise = given.noise[[first, second]]
    if noise.max() > _QUIETER * noise.min():
        demand, actual = (first, second) if noise[0] < noise[1] else (second, first)
        quiet, loud = float(noise.min()), float(noise.max())
        return (
            actual,
            demand,
            f"is smoother than {given.columns[actual].name} (noise {quiet:.2g} against {loud:.2g})",
        )
    if names[first] != names[second]:
        demand, actual = (first, second) if names[first] else (second, first)
        return actual, demand, "by its name; it neither leads nor is smoother"
    other = given.columns[first].name
    return first, second, f"neither leads nor is smoother: it may be the other way round with {other}"


def _speeds(
    given: Prepared, position: int, correlation: NDArray[np.float64], group: list[int], fixed: dict[str, int]
) -> list[Pair]:
    """Columns that are the slope of a position, the best first; measured ones before demanded."""
    candidates = (
        [fixed["speed"]] if "speed" in fixed else [k for k in range(len(given.columns)) if k not in group]
    )
    pairs: list[Pair] = []
    for k in candidates:
        r = float(correlation[position, k])
        if abs(r) > _IS_SLOPE or "speed" in fixed:
            slope = given.slope[given.edge : -given.edge, position]
            ratio = float(
                np.dot(slope, given.slow[given.edge : -given.edge, k]) / max(np.dot(slope, slope), 1e-300)
            )
            pairs.append(Pair(position, k, ratio, r))

    def rank(pair: Pair) -> tuple[bool, bool, float]:
        name = given.columns[pair.speed].name
        torque = sounds_like(name, (*TORQUE_WORDS, *_ACCELERATION_WORDS)) and not sounds_like(
            name, SPEED_WORDS
        )
        return torque, sounds_like(name, DEMAND_WORDS), -abs(pair.correlation)

    return sorted(pairs, key=rank)


def _torques(given: Prepared, position: int, taken: set[int], fixed: dict[str, int]) -> list[Torque]:
    """Columns that gather the speed of a position, the best first: least squares on acceleration, speed, its sign, a
    constant, and, of an angle, a weight."""
    speed = given.slope[:, position]
    acceleration = given.differentiated(speed)
    edge = given.edge
    spread = float(np.std(speed))
    columns = [acceleration, speed, np.tanh(speed / max(0.05 * spread, 1e-300)), np.ones_like(speed)]
    span = given.slow[:, position]
    columns += [np.sin(span), np.cos(span)] if 0.5 < np.ptp(span) < 100 else []
    matrix = np.column_stack(columns)[edge:-edge]
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    candidates = (
        [fixed["torque"]] if "torque" in fixed else [k for k in range(len(given.columns)) if k not in taken]
    )
    found: list[Torque] = []
    for k in candidates:
        name = given.columns[k].name
        if "torque" not in fixed and sounds_like(name, _ACCELERATION_WORDS):
            continue
        values = given.slow[edge:-edge, k]
        parts, *_ = np.linalg.lstsq(matrix / scale, values, rcond=None)
        parts = parts / scale
        fitted = matrix @ parts
        total = float(np.var(values))
        without, *_ = np.linalg.lstsq(matrix[:, 1:] / scale[1:], values, rcond=None)
        rest = float(np.var(values - matrix[:, 1:] @ (without / scale[1:])))
        left = float(np.var(values - fitted))
        explained = 1 - left / max(total, 1e-300)
        gained = (rest - left) / max(rest, 1e-300)
        if explained > _EXPLAINED or sounds_like(name, (*TORQUE_WORDS, *CURRENT_WORDS)) or "torque" in fixed:
            work = float(np.dot(values, speed[edge:-edge]))
            sign = float(np.sign(parts[0] if gained > SURE_GAIN else work)) or 1.0
            gathering = values - matrix[:, 1:] @ parts[1:]
            found.append(Torque(k, sign, explained, gained, float(parts[0]), fitted, gathering))

    def rank(torque: Torque) -> tuple[bool, bool, float]:
        name = given.columns[torque.column].name
        named = sounds_like(name, (*TORQUE_WORDS, *CURRENT_WORDS)) or bool(given.columns[torque.column].unit)
        return not named, sounds_like(name, DEMAND_WORDS), -torque.explained

    return sorted(found, key=rank)


def _each_torque_once(given: Prepared, joints: list[Joint]) -> list[Joint]:
    """Where there are several axes, each has a torque of its own: one with its number in the name, where names have
    numbers; else one that no other axis explains better. Speeds likewise."""
    if len(joints) < 2:
        return joints
    sorted_out: list[Joint] = []
    for joint in joints:
        own = _numbers_in(given, joint.position)
        torques = [each for each in joint.torques if own and _numbers_in(given, each.column) == own]
        torques = torques or [each for each in joint.torques if not _explained_better(each, joint, joints)]
        speeds = [
            each for each in joint.speeds if own and _numbers_in(given, each.speed) == own
        ] or joint.speeds
        best = next(iter(speeds), None)
        if torques:
            sorted_out.append(
                replace(
                    joint,
                    speed=None if best is None else best.speed,
                    ratio=None if best is None else best.ratio,
                    correlation=0.0 if best is None else best.correlation,
                    torques=tuple(torques),
                )
            )
    return sorted_out


def _numbers_in(given: Prepared, place: int) -> list[str]:
    return re.findall(r"\d+", given.columns[place].name)


def _explained_better(torque: Torque, joint: Joint, joints: list[Joint]) -> bool:
    rivals = [each for other in joints if other is not joint for each in other.torques]
    return any(each.column == torque.column and each.explained > torque.explained for each in rivals)
