"""Ours against the Cramér-Rao bound on the Table 1 machine: is there anything left to gain?

    python benchmarks/estimators_bound.py                       a minute; --seeds 8 for steadier numbers
    python benchmarks/estimators_bound.py --durations 0.1 --seeds 1 --limits 233

1/3 profile over half a turn and back, 46.6 N·m at 50 Hz, 4 kHz, noise of 0.02 rad/s and 0.1 N·m; a reference and four
phases, and for "auto" also a reference and one phase. RMSE is over all angles of all tables, none left out that the
method gives; the bound is that of the very runs which a method got, at the same angles: load torque, friction, delays,
stiffness and damping unknown as for the methods, noise as it was made. Both are rms over sessions of different noise.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from estimator_cases import ALL, CLEAN, PAIR, SLIDER_CRANK, Case, Entrant, believed, known, make_session
from estimators import noise_of

from schwung.drivetrain import Machine
from schwung.errors import SchwungError
from schwung.estimation import estimate
from schwung.estimation.bound import cramer_rao
from schwung.estimation.choice import AUTO
from schwung.session import Session

ENTRANTS = (
    Entrant("multiphase", ALL),
    Entrant("trajectory", ALL),
    Entrant(AUTO, ALL),
    Entrant("trajectory", PAIR),
    Entrant(AUTO, PAIR),
)
#: Torque limits (N·m): none, and the Table 1 motor's.
NO_LIMIT, TABLE_1_LIMIT = 1e6, 233.0
DURATIONS_S = (0.25, 0.2, 0.15, 0.1, 0.08)


@dataclass(frozen=True)
class Ratio:
    """Error and bound of one method over sessions, root mean square (kg·m²), and what it was."""

    rmse: float
    bound: float
    taken: str  # the methods that "auto" took
    inside: float  # share of cells whose 95 % band holds the truth

    @property
    def ratio(self) -> float:
        """Error over bound."""
        return self.rmse / self.bound


def ratio_of(sessions: Sequence[Session], case: Case, machine: Machine, entrant: Entrant) -> Ratio:
    """One method over sessions that differ in their noise."""
    errors, bounds, inside, taken = [], [], [], set()
    for session in sessions:
        given = entrant.given(session)
        found = estimate(given, machine, entrant.method)
        table, angles = found.table, found.table.position_rad
        error = table.inertia_kgm2 - case.inertia.at(angles)
        least = cramer_rao(given, known(given, machine, case.inertia), noise=noise_of(case.condition))
        errors.append(np.mean(error**2))
        bounds.append(np.mean(np.interp(angles, least.position_rad, least.std_kgm2) ** 2))
        inside.append(np.mean(np.abs(error) <= 1.96 * (table.std_kgm2 if table.std_kgm2 is not None else 0)))
        taken.add(found.method)
    means = (float(np.sqrt(np.mean(values))) for values in (errors, bounds))
    return Ratio(*means, ", ".join(sorted(taken)), float(np.mean(inside)))


def _lines(durations: Sequence[float], limits: Sequence[float], seeds: range) -> Iterator[str]:
    yield "| motion | torque limit | method | runs | RMSE, 10⁻⁶ kg·m² | bound | ratio | cells in their 95 % band |"
    yield "|---|---|---|--:|--:|--:|--:|--:|"
    for duration in durations:
        for limit in limits:
            each = [Case(SLIDER_CRANK, duration, CLEAN, seed) for seed in seeds]
            sessions = [make_session(case, limit) for case in each]
            machine = believed(sessions[0], clipped=False)
            if limit < NO_LIMIT:
                motor = machine.motor.model_copy(update={"peak_torque_nm": limit})
                machine = machine.model_copy(update={"motor": motor})
            for entrant in ENTRANTS:
                where = f"{1e3 * duration:g} ms | {'none' if limit >= NO_LIMIT else f'{limit:g} N·m'}"
                try:
                    found = ratio_of(sessions, each[0], machine, entrant)
                except SchwungError as refusal:
                    yield f"| {where} | {entrant.method} | {entrant.runs} | refused: {refusal} | | | |"
                    continue
                name = entrant.method + (f" ({found.taken})" if entrant.method == AUTO else "")
                yield (
                    f"| {where} | {name} | {entrant.runs} | {1e6 * found.rmse:.1f} | {1e6 * found.bound:.1f} "
                    f"| {found.ratio:.2f} | {100 * found.inside:.0f} % |"
                )


def main() -> None:
    """Make, estimate, print line by line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--durations", nargs="*", type=float, default=DURATIONS_S, help="of a stroke, s")
    parser.add_argument("--limits", nargs="*", type=float, default=(NO_LIMIT, TABLE_1_LIMIT), help="N·m")
    parser.add_argument("--seeds", type=int, default=3, help="sessions of different noise")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    given = parser.parse_args()
    for line in _lines(given.durations, given.limits, range(given.first, given.first + given.seeds)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
