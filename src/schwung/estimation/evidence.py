"""What a session itself says about an estimate's error: balances that a right table must keep, without the truth.

Three balances, each dimensionless, take the place of the paper's MIV (15) and position deviation (16), whose bounds
belong to one machine:

*The ripple's own curve.* The balance of momentum of the ripple (`balance.py`) needs no window and carries d(Jω)/dt.
A table made of windows of one period T is off from it by the window's bias: about ∂²J/∂t² T²/24 of smoothing, and by
J̇/(jω) for taking Jω̇ for d(Jω)/dt. MIV = max |J(t) − J(t − T)| ≈ |J̇| T bounds the latter by MIV/2π; here the bias
itself is measured: `difference`, the rms of table less curve over the mean, noise of the curve taken off.

*What the ripple leaves unexplained.* Torque of the ripple that no J(θ), friction and delay accounts for, over all of
it (rms): `unexplained`. A machine that is not linear over the ripple (play, sticking) shows here; the position
deviation's DC part was its sign, and counts dry friction, which does no harm, as much as play, which does.

*The motion.* Below half the injected frequency the same table has to carry the motion itself:

    T − b ω = s [J_r α_r + d(J_l ω_l)/dt − ½ J_l' ω_l²] + F sign(ω) + v ω + T_0 + T_1 cos θ + T_2 sin θ

by least squares, with one more free torque for each rest, where dry friction holds anything; s must be 1. The
coupling hardly winds up at so low a frequency, so that s does not depend on k, while the ripple's inertia does: with
x = (ω_est/ω_anti)², a stiffness off by ε puts J_l off by about x ε, and s with it. A wrong k, J_r or torque constant,
play and further compliance all leave s ≠ 1: `contradiction` = |s − 1| less 1.5 standard deviations. What no session
shows is a factor on all of its torques: without a coupling of known stiffness, or where the method fits the
stiffness, a wrong torque constant scales the result unseen, and a rotor inertia off by ΔJ shifts it by −ΔJ.

What the balances show beyond chance and beyond the band is left out of the band, and the same for all cells: it is
added to it by squares, once (`widened`), so that the table's own standard deviation is the error to be expected,
everywhere. The weights say how much of the inertia's error each part shows, and were set on simulated machines
(`benchmarks/calibration.py --hard`) that the published rates do not use. What stays unexplained is mostly noise, which
the band knows already: it makes doubts, no band, unless a fit of the whole record misses several times its noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.denoise import denoise
from schwung.estimation.fit import NOTHING, CurveFit, Nuisance, fit_curve
from schwung.estimation.left_out import along_way, taken
from schwung.estimation.methods import Outcome, Task
from schwung.estimation.ripple import phase_groups, ripple_of_pair, ripple_of_phases
from schwung.innovations.low_pass import low_passed
from schwung.innovations.splines import slopes
from schwung.motion import Array
from schwung.session.model import Run

#: The motion's balance is looked at below this share of the injected frequency.
MOTION_SHARE = 0.5
#: Signals are kept up to so many times that frequency until their products are made.
WIDE = 4.0
#: Dry friction turns round within this share of the top speed.
STICKING = 0.02
#: What a part shows of the inertia's error.
WEIGHT_MOTION, WEIGHT_UNEXPLAINED, WEIGHT_MISSED = 1.75, 0.5, 0.25
#: Standard deviations that count as chance.
CLEAR = 1.5
#: A fitted stiffness that differs from the file's may be chance, the file's mistake, or a wrong torque constant, which
#: shifts the inertia as much: a stiffness is known to 10 % beforehand, a torque constant to 3 %.
TORQUE_CONSTANT, STIFFNESS = 0.03, 0.1
#: Less likely than this, chance is none.
CHANCE = 0.05
#: A fit of the whole record sees more than these balances: on sound machines they are off by up to half a per cent.
COARSE = 0.005
#: A scale this uncertain says nothing.
VAGUE = 0.1


@dataclass(frozen=True)
class Evidence:
    """Relative errors (1: the mean inertia) that the session lets expect; None where it cannot tell."""

    band: float | None  # of the table, the median cell's, without what is left out of it
    difference: float | None
    unexplained: float | None
    scale: Nuisance | None  # s: what the motion asks for over what the table says
    missed: float | None  # of a whole-record method
    stiffer: Nuisance = NOTHING  # how far the stiffness found is from the file's
    spread: float = 0.0  # the band's root mean square: one wide cell counts in the rms difference, too
    whole: bool = False  # the fit took the motion and all runs itself
    misses: bool = False  # what it misses is physics that it leaves out, not noise

    @property
    def contradiction(self) -> float:
        """How far the motion contradicts the table beyond the balance's own uncertainty."""
        if self.scale is None or (self.scale.std > VAGUE and abs(self.scale.value - 1) < 3 * self.scale.std):
            return 0.0
        return max(abs(self.scale.value - 1) - CLEAR * self.scale.std, 0.0)

    @cached_property
    def parts(self) -> dict[str, float]:
        """Expected relative error by what shows it; by squares they make the whole."""
        coarse = COARSE if self.whole else 0.0
        found = {"motion": max(WEIGHT_MOTION * self.contradiction - coarse, 0.0)}
        if self.difference is not None:  # of windows, whose band knows of a part of it
            beyond = float(np.sqrt(max(self.difference**2 - self.spread**2, 0.0)))
            found["difference"] = max(beyond - coarse, 0.0)
        if self.stiffer.value:
            found["stiffness"] = _ambiguity(self.stiffer)
        if self.misses and self.missed is not None:
            found["missed"] = WEIGHT_MISSED * self.missed
        if self.band is not None:
            found["band"] = self.band
        return found

    @cached_property
    def doubts(self) -> dict[str, float]:
        """What stays unexplained, weighed as an error would be that went with it."""
        if self.unexplained is not None:
            return {"unexplained": WEIGHT_UNEXPLAINED * self.unexplained}
        return {} if self.missed is None or self.misses else {"missed": WEIGHT_MISSED * self.missed}

    @property
    def left_out(self) -> float:
        """What the band does not know of, relative to the mean inertia."""
        return float(np.sqrt(sum(part**2 for name, part in self.parts.items() if name != "band")))

    @property
    def predicted(self) -> float:
        """The relative error to be expected: that of the table, with what was left out."""
        return float(np.hypot(self.band or 0.0, self.left_out))


def _ambiguity(stiffer: Nuisance) -> float:
    """Relative error, one standard deviation, of an inertia beside which a stiffness was found so far from the file's:
    as far, times the root of the probability that the torque constant did it. Nothing where it may be chance.
    """
    sizes = np.hypot(max(stiffer.std, 1e-6), [0.0, STIFFNESS, TORQUE_CONSTANT])
    logs = -((stiffer.value / sizes) ** 2) / 2 - np.log(sizes)
    chance, _, constant = np.exp(logs - logs.max()) / np.sum(np.exp(logs - logs.max()))
    return 0.0 if chance > CHANCE else abs(stiffer.value) * float(np.sqrt(constant))


def widened(table: InertiaTable, left_out: float) -> InertiaTable:
    """The table, its band wider by a share of the mean inertia, (n,) by squares; without a band it stays without."""
    if table.std_kgm2 is None or left_out == 0:
        return table
    more = left_out * float(np.mean(table.inertia_kgm2))
    return replace(table, std_kgm2=np.hypot(table.std_kgm2, more))


def at_least(table: InertiaTable, left_out: float) -> InertiaTable:
    """The table, its band nowhere narrower than what is left out of it, a share of the mean inertia."""
    if table.std_kgm2 is None:
        return table
    least = left_out * float(np.mean(table.inertia_kgm2))
    return replace(table, std_kgm2=np.maximum(table.std_kgm2, least))


def relative_band(table: InertiaTable) -> float | None:
    """The one number that is told of a table: the median cell's standard deviation over the mean inertia.

    The median, as one wide cell at an edge condemns no table.
    """
    if table.std_kgm2 is None:
        return None
    return float(np.median(table.std_kgm2) / np.mean(table.inertia_kgm2))


def gather(outcome: Outcome, task: Task, table: InertiaTable) -> Evidence:
    """All that the session says about this table."""
    machine = outcome.machine or task.machine
    fit = outcome.fit or ripple_fit(task, machine)
    difference = unexplained = None
    carried = table
    if fit is not None:
        if outcome.windowed:  # the windows' bias is seen by the difference: once is enough
            carried = replace(table, inertia_kgm2=_curve(fit, table), std_kgm2=None)
        difference = 0.0 if outcome.fit is not None else _difference(fit, table)
        unexplained = float(np.sqrt(fit.unexplained_share))
    return Evidence(
        band=relative_band(table),
        difference=difference,
        unexplained=unexplained,
        scale=motion_scale(
            _motion_runs(task),
            machine,
            carried,
            task.frequency_hz,
            task.session.axis != "linear",
            shown=outcome.shown,
        ),
        missed=outcome.missed,
        misses=outcome.misses,
        stiffer=outcome.stiffer,
        spread=0.0
        if table.std_kgm2 is None
        else float(np.sqrt(np.mean(table.std_kgm2**2)) / np.mean(table.inertia_kgm2)),
        whole=outcome.machine is not None,
    )


def ripple_fit(task: Task, machine: Machine) -> CurveFit | None:
    """The window-free curve of the same runs; None where nothing takes the motion out of them."""
    groups = phase_groups(task.excited)
    try:
        if groups:
            ripples = [ripple_of_phases(group) for group in groups]
        elif task.session.references:
            ripples = [ripple_of_pair(pair) for pair in denoise(task.session, task.excited)]
        else:
            return None
        fit = fit_curve(ripples, machine)
    except (InputError, np.linalg.LinAlgError):
        return None
    return fit if fit.physical else None


def _curve(fit: CurveFit, table: InertiaTable) -> Array:
    """The fit's inertia at the table's angles; positive, also where the ripple says little."""
    return np.maximum(fit.inertia_at(table.position_rad), 1e-3 * float(np.mean(table.inertia_kgm2)))


def _difference(fit: CurveFit, table: InertiaTable) -> float:
    """Rms of table less curve over the mean inertia, what the curve's own variance makes by chance taken off."""
    off = table.inertia_kgm2 - fit.inertia_at(table.position_rad)
    beyond = float(np.mean(off**2 - (CLEAR * fit.std_at(table.position_rad)) ** 2))
    return float(np.sqrt(max(beyond, 0.0))) / float(np.mean(table.inertia_kgm2))


def _motion_runs(task: Task) -> Sequence[Run]:
    """Runs of one motion whose mean shows it best: a set of phases, the references, or one excited run."""
    groups = phase_groups(task.excited)
    if groups:
        return groups[0]
    if task.session.references:
        first = task.session.references[0]
        return [run for run in task.session.references if run.motion == first.motion]
    return task.excited[:1]


def motion_scale(
    runs: Sequence[Run],
    machine: Machine,
    table: InertiaTable,
    frequency_hz: float,
    rotary: bool,
    shown: Sequence[int] = (),
) -> Nuisance | None:
    """s of the motion's balance (see above) and its standard deviation; None where the record is too short.

    `runs` are of one motion and averaged. Friction, a constant torque and on a rotary axis a weight (first harmonic
    of the load angle) are fitted beside it and may be anything, and what else was `shown` (of `LEFT_OUT`).
    """
    n = min(len(run) for run in runs)
    rate = runs[0].sample_rate_hz
    edge = MOTION_SHARE * frequency_hz
    margin = int(rate / edge)
    if n < 6 * margin or 2 * edge / rate >= 1:
        return None
    below = _low_pass(edge, rate)
    # products are made of wider signals and filtered then: the other way round a jerk and a bend would miss each other
    wide = _low_pass(min(WIDE * edge, 0.45 * rate), rate)

    def mean(name: str) -> Array:
        return wide(np.mean([getattr(run, name)[:n] for run in runs], axis=0))

    def rate_of(values: Array) -> Array:
        # half the difference of two neighbours is (ωh)²/6 too little, 0.4 % at 25 Hz and 1 kHz: more than the band
        return slopes(values, 1 / rate)

    position, speed, torque = mean("position_rad"), mean("speed_rad_s"), mean("torque_nm")
    top = float(np.max(np.abs(speed)))
    if top == 0:
        return None
    motor = machine.motor
    rotor = motor.inertia_kgm2 * rate_of(speed)
    load, load_speed = position, speed
    if machine.coupling is not None:
        wind_up = (torque - rotor - motor.viscous_friction_nms * speed) / machine.coupling.stiffness_nm_rad
        load, load_speed = position - wind_up, speed - rate_of(wind_up)
    inertia = table.at(load)
    moved = rotor + inertia * rate_of(load_speed) + rate_of(inertia) * load_speed / 2
    known = motor.viscous_friction_nms * speed + machine.load.viscous_friction_nms * load_speed
    known = known - machine.load_torque_at(load)
    columns = [moved, np.tanh(speed / (STICKING * top)), speed / top, np.ones(n)]
    if rotary:
        columns += [np.cos(load), np.sin(load)]
    if shown:
        along = along_way(load, float(table.position_rad[0]), float(table.position_rad[-1]))
        carried, direction = torque - rotor, np.tanh(speed / (STICKING * top))
        hidden = taken(torque, carried, speed, direction, along, motor.peak_torque_nm, top)
        columns += list(hidden[:, list(shown)].T)
    columns += _rests(speed, STICKING * top, margin)
    inner = slice(margin, -margin)
    design = np.column_stack([below(column)[inner] for column in columns])
    return _first_of(design, below(torque - known)[inner], 2 * edge * n / rate)


def _rests(speed: Array, slowest: float, shortest: int) -> list[Array]:
    """One column per rest: dry friction holds any torque there."""
    turns = np.flatnonzero(np.diff(np.concatenate([[False], np.abs(speed) < slowest, [False]]).astype(int)))
    columns = []
    for start, end in zip(turns[::2], turns[1::2], strict=True):
        if end - start > shortest:
            columns.append(np.zeros(speed.size))
            columns[-1][start:end] = 1.0
    return columns


def _low_pass(edge_hz: float, rate_hz: float) -> Callable[[Array], Array]:
    return lambda values: low_passed(values, 2 * edge_hz / rate_hz, 2)


def _first_of(design: Array, y: Array, independent: float) -> Nuisance | None:
    """Least squares: the first coefficient, of so many independent samples."""
    size = np.linalg.norm(design, axis=0)
    if size[0] == 0 or independent < design.shape[1] + 2:
        return None
    scaled = design / np.maximum(size, 1e-300)
    solution = np.linalg.lstsq(scaled, y, rcond=1e-8)[0]
    left = y - scaled @ solution
    variance = float(left @ left) / (independent - design.shape[1])
    spread = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)[0, 0] * variance
    return Nuisance(float(solution[0] / size[0]), float(np.sqrt(max(spread, 0.0)) / size[0]))
