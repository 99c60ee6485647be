"""The values that programs get: those of the rooms below, with a table, a picture and columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from schwung import drivetrain, session
from schwung.api.shown import Shown, as_shown, number, span
from schwung.estimation import values as estimation
from schwung.quantities import sentences_of
from schwung.report.content import LINEAR, ROTARY, Units
from schwung.report.rows import rows_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def units_of(axis: str) -> Units:
    """Units and words of a rotary or a linear axis."""
    return LINEAR if axis == "linear" else ROTARY


class InertiaTable(Shown, drivetrain.InertiaTable):
    """Load inertia over the load angle, held constant outside, monotone between points (PCHIP).

    Attributes: `position_rad` (rad), increasing, `inertia_kgm2` (kg·m²) and `std_kgm2` (kg·m², one standard deviation,
    or None), shape (n,) each; on a linear axis m and kg. `at(position_rad)` interpolates, `slope_at` gives dJ/dθ.

    Raises InputError where columns differ in length, angles do not increase, or an inertia is not positive.

    >>> import numpy as np
    >>> table = schwung.InertiaTable(np.array([0.0, 1.0, 2.0]), np.array([0.1, 0.3, 0.2]))
    >>> table.at(np.array([1.0]))
    array([0.3])
    """

    def _facts(self) -> Sequence[tuple[str, str]]:
        unit = sentences_of(self.effort)("kg·m²")
        yield_std = [] if self.std_kgm2 is None else [("± (1σ)", span(self.std_kgm2, unit))]
        return [
            ("load inertia", span(self.inertia_kgm2, unit)),
            ("load angle", span(self.position_rad, "rad")),
            ("points", str(self.position_rad.size)),
            *yield_std,
        ]

    def _draw(self, axes: Axes) -> None:
        from schwung.report.axes import draw_inertia

        draw_inertia(axes, self, ROTARY)

    def _columns(self) -> Mapping[str, Any]:
        end = "as2_rad" if self.effort == "current" else "kgm2"
        columns = {"position_rad": self.position_rad, f"inertia_{end}": self.inertia_kgm2}
        return columns if self.std_kgm2 is None else columns | {f"std_{end}": self.std_kgm2}


class Machine(Shown, drivetrain.Machine):
    """What is believed about a machine: `motor`, `coupling` (None: rigid), `load`, `control` (None: gains unknown) and
    the learned `physics` terms. Units are in the names, as in `motor.inertia_kgm2` (kg·m²); tables have shape (n,).

    Raises InputError where numbers cannot be a machine's, as a load of 10 000 rotors.

    >>> import schwung
    >>> machine = schwung.example_machine()
    >>> machine.motor.inertia_kgm2, machine.load_inertia
    (0.012, 0.11)
    """

    def _facts(self) -> Sequence[tuple[str, str]]:
        tables = {"load": {"inertia_table", "torque_table"}}
        content = self.model_dump(exclude_none=True, exclude=tables | {"name": True})
        table = self.load.inertia_table
        measured = [] if table is None else [("load inertia, kg·m²", span(table.inertia_kgm2, ""))]
        physics = [(f"physics: {term.name}", "learned") for term in self.physics]
        content.pop("physics", None)
        return [("name", self.name), *rows_of(content), *measured, *physics]

    def _draw(self, axes: Axes) -> None:
        table = self.load.inertia_table
        if table is None:
            super()._draw(axes)
        else:
            as_shown(InertiaTable, table).plot(axes)


class Run(Shown, session.Run):
    """One recorded motion. `role` is "reference" (without) or "excited" (with the injected sine).

    Attributes, shape (n,) each: `time_s` (s), `position_rad` (rad), `speed_rad_s` (rad/s), `torque_nm` (N·m), and where
    recorded `position_demand_rad` (rad) and `torque_added_nm` (N·m); `sample_rate_hz` (Hz). On a linear axis m, m/s, N.

    Raises InputError where arrays differ in length, are not finite, or time does not increase evenly.

    >>> session = schwung.read_session(session_file)
    >>> run = session.excited[0]
    >>> run.role, run.sample_rate_hz, run.torque_nm.shape == run.time_s.shape
    ('excited', 1000.0, True)
    """

    def _facts(self) -> Sequence[tuple[str, str]]:
        return [
            ("role", f"{self.role}, repeat {self.repeat}"),
            ("samples", f"{len(self)} at {self.sample_rate_hz:g} Hz"),
            ("angle", span(self.position_rad, "rad")),
            ("torque", span(self.torque_nm, "N·m")),
        ]

    def _draw(self, axes: Axes) -> None:
        from schwung.report.axes import draw_torque

        draw_torque(axes, self, ROTARY)

    def _columns(self) -> Mapping[str, Any]:
        ends = {"time": "time_s", "position": "position_rad", "speed": "speed_rad_s", "torque": "torque_nm",
                "position_demand": "position_demand_rad", "torque_added": "torque_added_nm"}  # fmt: skip
        return {ends[name]: values for name, values in self.datasets().items()}


class Session(Shown, session.Session):
    """Every run of one recording session: `runs` in their order, `references` and `excited` of them, `axis` ("rotary"
    or "linear"), `drive` (what was known of the drive, or None). Arrays of a run have shape (n,), in rad, rad/s, N·m.

    `to_dataframe()` has the samples of all runs below each other, with columns `run` and `role`.

    Raises InputError where `read_session` does.

    >>> session = schwung.read_session(session_file)
    >>> [run.role for run in session.runs]
    ['reference', 'excited']
    """

    runs: tuple[Run, ...]

    def _facts(self) -> Sequence[tuple[str, str]]:
        length = sum(float(run.time_s[-1] - run.time_s[0]) for run in self.runs)
        return [
            ("recorded", f"{self.created}, {self.source}"),
            ("runs", f"{len(self.references)} reference, {len(self.excited)} excited"),
            (
                "length",
                f"{number(length, 's')} at {', '.join(sorted({f'{r.sample_rate_hz:g}' for r in self.runs}))} Hz",
            ),
            *((("torque", "a current, in A: N·m per A is unknown"),) if self.effort == "current" else ()),
            *((("cut short", "; ".join(self.partial_reasons)),) if self.partial_reasons else ()),
        ]

    def _draw(self, axes: Axes) -> None:
        from schwung.report.axes import draw_positions

        draw_positions(axes, self.runs, units_of(self.axis))

    def _columns(self) -> Mapping[str, Any]:
        import numpy as np

        every = [as_shown(Run, run)._columns() for run in self.runs]
        if self.effort == "current":
            every = [{name.replace("_nm", "_a"): each for name, each in own.items()} for own in every]
        names = list(dict.fromkeys(name for columns in every for name in columns))
        counts = [len(run) for run in self.runs]
        absent = [np.full(count, np.nan) for count in counts]
        return {
            "run": np.repeat(np.arange(len(counts)), counts),
            "role": np.repeat([run.role for run in self.runs], counts),
            **{
                name: np.concatenate([c.get(name, gap) for c, gap in zip(every, absent, strict=True)])
                for name in names
            },
        }


class Estimate(Shown, estimation.Estimate):
    """Load inertia over load angle, and how far to trust it.

    Attributes: `table` (an InertiaTable, rad and kg·m², (n,)), `trust` (`verdict` "good", "doubtful" or
    "unusable", with `reasons`), `method`, `frequency_hz` (Hz), `notes`, and per excited run `traces` and `denoised`,
    arrays (n,).
    `to_json()`: everything but the samples.

    Raises InputError where `estimate` does.

    >>> found = schwung.estimate(schwung.read_session(session_file), schwung.example_machine())
    >>> found.trust.verdict
    'good'
    """

    table: InertiaTable

    def _facts(self) -> Sequence[tuple[str, str]]:
        return [
            ("verdict", f"{self.trust.verdict}: {'; '.join(self.trust.reasons)}"),
            *self.table._facts(),
            ("method", f"{self.method}, at {self.frequency_hz:g} Hz"),
        ]

    def _draw(self, axes: Axes) -> None:
        self.table._draw(axes)

    def _columns(self) -> Mapping[str, Any]:
        return self.table._columns()


class Simulated(Shown, drivetrain.Simulated):
    """What the simulated drive would report.

    Attributes, shape (n,) each: `time_s` (s), `demand_position_rad`, `position_rad` and `load_position_rad` (rad,
    absolute), `speed_rad_s` and `load_speed_rad_s` (rad/s), `torque_nm` (N·m), `clipped` (whether peak torque was not
    enough). Peaks: `peak_torque_nm` (N·m), `peak_speed_rad_s` (rad/s), `peak_following_error_rad` (rad).

    Raises InputError where `simulate` does.

    >>> motion = schwung.Motion(distance_rad=1.0, duration_s=0.25)
    >>> moved = schwung.simulate(schwung.example_machine(control=True), motion)
    >>> bool(moved.clipped.any())
    False
    """

    def _facts(self) -> Sequence[tuple[str, str]]:
        return [
            ("peak torque", number(self.peak_torque_nm, "N·m") + (", clipped" if self.clipped.any() else "")),
            ("peak speed", number(self.peak_speed_rad_s, "rad/s")),
            ("peak following error", number(self.peak_following_error_rad, "rad")),
            ("angle", span(self.position_rad, "rad")),
        ]

    def _draw(self, axes: Axes) -> None:
        from schwung.report.axes import draw_simulated

        draw_simulated(axes, self, ROTARY)

    def _columns(self) -> Mapping[str, Any]:
        names = ("time_s", "demand_position_rad", "position_rad", "speed_rad_s", "torque_nm", "load_position_rad",
                 "load_speed_rad_s", "clipped")  # fmt: skip
        return {name: getattr(self, name) for name in names}


def machine_shown(machine: drivetrain.Machine) -> Machine:
    """A machine from below as one that shows itself."""
    return machine if isinstance(machine, Machine) else Machine.model_validate(dict(machine), by_name=True)


def session_shown(recorded: session.Session) -> Session:
    """A session from below, with all of its runs."""
    return as_shown(Session, recorded, runs=tuple(as_shown(Run, run) for run in recorded.runs))


def estimate_shown(found: estimation.Estimate) -> Estimate:
    """An estimate from below, with its table."""
    return as_shown(Estimate, found, table=as_shown(InertiaTable, found.table))
