"""Fit of named terms to whitened residuals: Gauss-Newton with a damped step, on any set of runs.

How late the motion is behind the torque is always fitted along, and how the drive's filter bends the torque, as far as
the speed does not say: every drive samples and filters a little, and tells nobody. The
phases of a disturbance fixed in frequency differ from run to run and are solved for within each run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from schwung.drivetrain.effects import Effects
from schwung.explain.noise import Whitener, usable
from schwung.explain.residual import TABLE_POINTS, Memory, Residuals, Unknowns
from schwung.explain.terms import LIBRARY, LOAD_TABLE, TABLE_FIELDS
from schwung.motion import Array

TIMING, BEND = "timing_s", "bend_s2"
PERIODIC = "periodic_disturbance"
#: How much the objective may still fall when a fit is called done.
_TOLERANCE = 0.1
_STEP = 1e-3  # of the finite differences, over a parameter's scale
#: The same where the likelihood is rough, for whether a load lifts off once more hangs on noise.
_COARSE = {"gap_rad": 0.2}
_WAVES_KEPT = 200  # pairs of sine and cosine that are remembered
#: A refinement of a term takes so large a share of the misfit, where that is so much above the noise.
REFINED_SHARE, REFINED_MISFIT = 0.05, 1.2
#: A refinement is fitted where a linear look promises this part of that.
HOPED = 0.3
_BOLDEST = 3.0  # steps of the parameter's scale in one iteration


@dataclass(frozen=True, eq=False)
class Model:
    """Named terms with the values that they have."""

    terms: tuple[str, ...] = ()
    unknowns: Unknowns = field(default_factory=Unknowns)
    frequency_hz: float = 0.0  # of the periodic disturbance, where that is one of the terms
    fixed: tuple[str, ...] = ()  # fields that stay as they are (profiles of the likelihood, unused keys)
    refined: tuple[str, ...] = ()  # fields that are fitted beside the terms' own

    @property
    def effects(self) -> Effects:
        return self.unknowns.effects

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that are fitted: what the drive's filter does first, then fields of Effects."""
        fields = [field for term in self.terms if term != PERIODIC for field in LIBRARY[term].parameters]
        if LOAD_TABLE in self.terms:
            fields += TABLE_FIELDS[: len(self.unknowns.load_table_nm)]
        if PERIODIC in self.terms:
            fields.append("periodic_frequency_hz")
        fields += self.refined
        return (TIMING, BEND, *(f for f in dict.fromkeys(fields) if f not in self.fixed))

    def value(self, name: str) -> float:
        """One parameter."""
        if name == TIMING:
            return self.unknowns.timing_s
        if name == BEND:
            return self.unknowns.bend_s2
        if name == "periodic_frequency_hz":
            return self.frequency_hz
        if name in TABLE_FIELDS:
            return (
                self.unknowns.load_table_nm[TABLE_FIELDS.index(name)] if self.unknowns.load_table_nm else 0.0
            )
        return float(getattr(self.effects, name))

    def is_bounded(self, name: str) -> bool:
        """Whether a parameter stands where its term ends."""
        bounds = (LIBRARY[term].bounds.get(name, ()) for term in self.terms if term in LIBRARY)
        return any(self.value(name) == end for ends in bounds for end in ends)

    def with_values(self, values: Mapping[str, float]) -> Model:
        """The model with some parameters changed; tied fields follow, bounds hold."""
        fields: dict[str, float] = {}
        timing, bend, frequency = self.unknowns.timing_s, self.unknowns.bend_s2, self.frequency_hz
        table = list(self.unknowns.load_table_nm)
        bounds = {f: b for term in self.terms if term in LIBRARY for f, b in LIBRARY[term].bounds.items()}
        tied = {LIBRARY[t].tied[0]: LIBRARY[t].tied for t in self.terms if t in LIBRARY and LIBRARY[t].tied}
        for name, value in values.items():
            if name == TIMING:
                timing = value
            elif name == BEND:
                bend = value
            elif name == "periodic_frequency_hz":
                frequency = max(value, 0.1)
            elif name in TABLE_FIELDS:
                table = table or [0.0] * TABLE_POINTS
                table[TABLE_FIELDS.index(name)] = value
            else:
                low, high = bounds.get(name, (-np.inf, np.inf))
                for field in tied.get(name, (name,)):
                    fields[field] = min(max(value, low), high)
        effects = self.effects._replace(**fields)
        unknowns = replace(
            self.unknowns, effects=effects, timing_s=timing, bend_s2=bend, load_table_nm=tuple(table)
        )
        return replace(self, unknowns=unknowns, frequency_hz=frequency)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model with how well it fits: Σ of squared whitened residuals over `samples`, the last no recorded one."""

    model: Model
    chi2: float
    samples: int
    jacobian: Array  # (samples, parameters), ∂(whitened residual)/∂parameter
    white: Array  # (samples,)
    bias: Mapping[str, float] = field(default_factory=dict)  # of parameters, by noise in the measured motion
    spread: Mapping[str, float] = field(
        default_factory=dict
    )  # deviations over those of white noise, at least 1

    @property
    def misfit(self) -> float:
        """Mean square of the whitened residual; 1 at the noise floor."""
        return self.chi2 / max(self.samples, 1)

    @property
    def told(self) -> Model:
        """The model without its bias."""
        return self.model.with_values({name: self.model.value(name) - b for name, b in self.bias.items()})

    def covariance(self) -> Array:
        """Of the parameters, with the residual's own level in place of the floor's where it is higher."""
        information = self.jacobian.T @ self.jacobian
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-10)
        return np.asarray(inverse / np.outer(scale, scale) * max(self.misfit, 1.0))


@dataclass(frozen=True, eq=False)
class Problem:
    """Whitened residuals of some runs."""

    residuals: Residuals
    whitener: Whitener
    runs: tuple[int, ...]
    known: Memory = field(default_factory=lambda: Memory(_WAVES_KEPT), repr=False)

    @property
    def samples(self) -> int:
        return sum(int(usable(self.residuals.valid(run)).sum()) for run in self.runs)

    def white(self, model: Model) -> Array:
        """Whitened residuals of all runs and, last, of what is known of the drive's filter, (samples + 1,)."""
        return np.asarray(self.several((model,))[0])

    def several(self, models: Sequence[Model]) -> Array:
        """The same for several models, which together cost less, (models, samples + 1)."""
        std = self.residuals.prepared.bend_std_s2
        bends = np.array([[model.unknowns.bend_s2 / std] for model in models])
        return np.concatenate([*(self._several(run, models) for run in self.runs), bends], axis=1)

    def _several(self, run: int, models: Sequence[Model]) -> Array:
        residuals = self.residuals.several(run, [model.unknowns for model in models])
        white = self.whitener.white(residuals, self.residuals.valid(run))
        for row, model in enumerate(models):
            if PERIODIC in model.terms:
                basis = self._basis(run, model.frequency_hz)
                white[row] -= basis @ (basis.T @ white[row])
        return white

    def _basis(self, run: int, frequency_hz: float) -> Array:
        """Sine and cosine of one frequency, made orthogonal, (samples, 2); whitening would only mix the two."""
        return self.known.of((run, frequency_hz), lambda: np.linalg.qr(self._turning(run, frequency_hz))[0])

    def _turning(self, run: int, frequency_hz: float) -> Array:
        time = self.residuals.runs[run].signals.time_s[:: self.residuals.prepared.every]
        turn = 2 * np.pi * frequency_hz * time[usable(self.residuals.valid(run))]
        return np.stack([np.sin(turn), np.cos(turn)], axis=1)

    def waves(self, run: int, frequency_hz: Array) -> Array:
        """Whitened sine and cosine of the run's time, as a torque of 1 N·m shows: (2, frequencies, samples)."""
        of = self.residuals.runs[run]
        every, band = self.residuals.prepared.every, self.residuals.prepared.band_hz
        turn = 2 * np.pi * np.multiply.outer(frequency_hz, of.signals.time_s[::every])
        gain = 1 / (1 + (frequency_hz / band) ** 8)
        waves = gain[:, None] * np.stack([np.sin(turn), np.cos(turn)])
        return self.whitener.white(waves, of.valid)

    def jacobian(self, model: Model, white: Array) -> Array:
        """∂(whitened residual)/∂parameter by differences, (samples, parameters)."""
        steps = {name: _COARSE.get(name, _STEP) * self.scale(model, name) for name in model.names}
        moved = [model.with_values({name: model.value(name) + step}) for name, step in steps.items()]
        changes = self.several(moved) - white
        return np.asarray((changes / np.array(list(steps.values()))[:, None]).T)

    def scale(self, model: Model, name: str) -> float:
        """The size of a parameter: its value, or what is small for its kind."""
        smallest = _SMALLEST.get(name, 0.01)
        if name == TIMING:
            return 1e-5
        if name == BEND:
            return self.residuals.prepared.bend_std_s2
        return max(abs(model.value(name)) * _SHARE.get(name, 0.1), smallest)

    def fit(self, model: Model, iterations: int = 10) -> Fitted:
        """The nearest minimum of Σ (whitened residual)²."""
        white = self.white(model)
        chi2, damping = float(white @ white), 1e-4
        columns = self.jacobian(model, white)
        for _ in range(iterations):
            scale = np.sqrt(np.maximum(np.sum(columns**2, axis=0), 1e-300))
            scaled = columns / scale
            normal, gradient = scaled.T @ scaled, scaled.T @ white
            improved = False
            for _ in range(6):
                step = -np.linalg.solve(normal + damping * np.eye(scale.size), gradient) / scale
                values = {
                    name: model.value(name) + _bounded(change, self.scale(model, name))
                    for name, change in zip(model.names, step, strict=True)
                }
                trial = model.with_values(values)
                trial_white = self.white(trial)
                with np.errstate(over="ignore"):  # too bold a step: infinitely bad
                    trial_chi2 = float(trial_white @ trial_white)
                if trial_chi2 < chi2:
                    improved = True
                    break
                damping *= 10
            if not improved:
                break
            gain, chi2 = chi2 - trial_chi2, trial_chi2
            model, white, damping = trial, trial_white, max(damping / 10, 1e-9)
            columns = self.jacobian(model, white)
            if gain < _TOLERANCE * max(chi2 / white.size, 1.0) + 1e-6 * chi2:
                break
        return Fitted(model, chi2, white.size, columns, white)

    def refine(self, fitted: Fitted) -> Fitted:
        """With those refinements of its terms that take a good share of what it misses: one name, one more key."""
        for term in fitted.model.terms:
            for name, values in () if term == PERIODIC else LIBRARY[term].refinements.items():
                if fitted.misfit < REFINED_MISFIT or name in fitted.model.refined:
                    continue
                begun = replace(fitted.model, refined=(*fitted.model.refined, name))
                speed = max(self.residuals.prepared.peak_speed_rad_s, 1e-12)  # from 0 there is no scale
                level = 0.1 * self.whitener.torque_nm * float(np.sqrt(fitted.misfit)) / speed
                starts = [begun.with_values({name: value}) for value in values or (level,)]
                fits = [self.fit(start) for start in starts if self._promising(fitted, start)]
                finer = min(fits, key=lambda one: one.chi2, default=fitted)
                if fitted.chi2 - finer.chi2 > REFINED_SHARE * fitted.chi2:
                    fitted = finer
        return fitted

    def _promising(self, fitted: Fitted, start: Model) -> bool:
        """Whether a refinement takes enough in a linear look, the other parameters moving along."""
        columns = np.column_stack([fitted.jacobian, self.white(start) - fitted.white])
        columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        basis, _ = np.linalg.qr(columns)
        return float(np.sum((basis[:, -1] @ fitted.white) ** 2)) > HOPED * REFINED_SHARE * fitted.chi2


def _bounded(change: float, scale: float) -> float:
    """A step that does not leave the region in which the slopes mean something."""
    return (
        float(np.clip(change, -_BOLDEST * 10 * scale, _BOLDEST * 10 * scale)) if np.isfinite(change) else 0.0
    )


#: Scales of parameters that are at or near zero (SI), and the share of their value where that is not 0.1.
_SMALLEST: Mapping[str, float] = {
    "stribeck_speed_rad_s": 1e-3, "local_centre_rad": 0.02, "local_width_rad": 0.02, "load_phase_rad": 0.1,
    "cogging_phase_rad": 0.1, "cogging_order": 0.02, "event_time_s": 1e-3, "event_duration_s": 1e-3,
    "torque_lag_s": 1e-5, "eccentricity_rad": 1e-6, "eccentricity_phase_rad": 0.1, "gap_rad": 1e-7,
    "inertia_shift_rad": 1e-3, "inertia_delta_kgm2": 1e-9, "viscous_nms": 1e-6, "drag_nms2": 1e-8,
    "viscous_difference_nms": 1e-6,
    "third_inertia_kgm2": 1e-9, "coulomb_positive_nm": 1e-5, "coulomb_negative_nm": 1e-5, "drift_nm": 1e-5,
    "offset_nm": 1e-5, "load_amplitude_nm": 1e-5, "local_friction_nm": 1e-5, "stribeck_rise_nm": 1e-5,
    "event_peak_nm": 1e-5, "cogging_amplitude_nm": 1e-5, "periodic_frequency_hz": 0.01, "torque_gain": 1e-3,
    "inertia_scale": 1e-3, "cubic_nm_rad3": 1.0, "drift_settling": 0.1,
}  # fmt: skip
_SHARE: Mapping[str, float] = {
    "cogging_order": 0.0, "local_centre_rad": 0.0, "event_time_s": 0.0, "periodic_frequency_hz": 0.0,
    "load_phase_rad": 0.0, "cogging_phase_rad": 0.0, "eccentricity_phase_rad": 0.0,
}  # fmt: skip


def combined(model: Model, term: str, fields: Mapping[str, float]) -> Model:
    """The model with one more term at given fields."""
    terms = tuple(dict.fromkeys((*model.terms, term)))
    grown = replace(model, terms=terms)
    return grown.with_values(fields)


def without(model: Model, term: str) -> Model:
    """The model without one of its terms."""
    neutral = Effects()
    kept = tuple(t for t in model.terms if t != term)
    if term == PERIODIC:
        return replace(model, terms=kept)
    if term == LOAD_TABLE:
        return replace(model, terms=kept, unknowns=replace(model.unknowns, load_table_nm=()))
    held = {f for t in kept if t != PERIODIC for f in _fields(t)}
    fields = {f: getattr(neutral, f) for f in _fields(term) if f not in held}
    unknowns = replace(model.unknowns, effects=model.effects._replace(**fields))
    refined = tuple(f for f in model.refined if f not in LIBRARY[term].refinements)
    return replace(model, terms=kept, unknowns=unknowns, refined=refined)


def _fields(term: str) -> tuple[str, ...]:
    """Every field that a term may set."""
    return (*LIBRARY[term].parameters, *LIBRARY[term].tied, *LIBRARY[term].refinements)


def parameter_count(terms: Sequence[str], runs: int) -> int:
    """Free parameters of some terms; a periodic disturbance has a phase in every run."""
    return sum(2 * runs + 1 if t == PERIODIC else len(LIBRARY[t].parameters) for t in terms)
