"""Figures 13 and 14 and Table 2: the paper's validation, on the simulated machine in the place of the real one."""

from __future__ import annotations

import numpy as np

from schwung.report.colours import DOUBTFUL, ESTIMATE, EXCITED, FORMER, GOOD, INK
from schwung.report.reproduction.experiments import (
    Case,
    dpr_of,
    machine,
    result_of,
    routh_limit_kgm2,
    truth,
)
from schwung.report.reproduction.layout import (
    Reproduced,
    draw_deviation,
    draw_error,
    draw_estimate,
    draw_miv_limits,
    draw_truth,
    draw_variation,
    legend,
    mean_deviation,
    named,
    panels,
)
from schwung.report.style import curve, in_style

REFERENCE = Case(0.5)
SHORTER = ((Case(0.30), GOOD), (Case(0.25), ESTIMATE), (Case(0.20), DOUBTFUL))


def _gains_used() -> str:
    printed, used = routh_limit_kgm2(100.0, 5.65, 8e-3), routh_limit_kgm2(60.0, 7.0, 8e-3)
    largest = machine().motor.inertia_kgm2 + float(np.max(truth().inertia_kgm2))
    return (
        "the validation machine's gains as printed (100 1/s, 5.65 N·m·s/rad, 8 ms) are unstable for our inferred "
        "inertia: by Routh a rigid machine may have J_r + J_l up to (K_ps + b_r + b_l)(T_n + 1/K_pp) = "
        f"{printed:.3f} kg·m² with them, ours has up to {largest:.3f}. Those of the paper's simulation (60, 7, 8 ms; "
        f"up to {used:.3f}; just enough for motions, if not for standing still at the top) were used instead"
    )


@in_style
def figure_13() -> Reproduced:
    """The former method at 500 ms."""
    result = result_of(REFERENCE, "former")
    run = result_of(REFERENCE).estimate.denoised[0].excited
    drawn = panels(6.2, ("ac", "ad", "be"), (1, 1, 1.1))
    draw_truth(drawn["a"])
    draw_estimate(drawn["a"], result, FORMER, "former method, 500 ms", width=1.6)
    draw_error(drawn["b"], result, FORMER)
    drawn["a"].set_ylim(0, 0.22)
    legend(drawn["a"])
    drawn["a"].tick_params(labelbottom=False)
    time = run.time_s - REFERENCE.start_s
    for name, title, values in (
        ("c", "Motor angle, rad", run.position_rad),
        ("d", "Motor speed, rad/s", run.speed_rad_s),
        ("e", "Motor torque, N·m", run.torque_nm),
    ):
        curve(drawn[name], time, values, EXCITED if name != "c" else INK, width=0.9)
        drawn[name].set_title(f"{name}  {title}")
    drawn["a"].set_title("a  Load inertia, kg·m²")
    drawn["b"].set_title("b  Error, kg·m²")
    drawn["b"].set_xlabel("load angle, rad")
    drawn["a"].sharex(drawn["b"])
    drawn.same_x("cde", "time since start, s")
    drawn["e"].set_xlim(-0.1, 0.7)
    return Reproduced(
        title="Figure 13: the former method at 500 ms, 50 Hz, 20 % of T_max",
        paper="RMSE 0.0073, σ 0.0066, max 0.0224 kg·m², at a DPR of 0.075 (measured on the machine).",
        here=f"{result.errors}, at a DPR of {dpr_of(REFERENCE, 0.11):.3f} (at J_l = 0.11 kg·m²).",
        difference=_gains_used()
        + ". Theirs was a machine, with friction, play and a load torque that ours lacks; still "
        "the former method is about as far off here, since its error is its own: the motion that leaks through the "
        "filter.",
        figure=drawn.figure,
    )


@in_style
def figure_14() -> Reproduced:
    """The denoised method at 300, 250 and 200 ms."""
    drawn = panels(8.2, ("ae", "bf", "cg", "dh"), (1.3, 1, 1, 1))
    draw_truth(drawn["a"])
    for case, colour in SHORTER:
        result = result_of(case)
        pair = result.estimate.denoised[0]
        draw_estimate(drawn["a"], result, colour, named(case))
        draw_variation(drawn["b"], result, colour)
        draw_error(drawn["c"], result, colour)
        draw_deviation(drawn["d"], result, case, colour)
        trace, start = result.estimate.traces[0], case.start_s
        for name, time, values in (
            ("e", pair.time_s, pair.excited.position_rad),
            ("f", trace.time_s, trace.speed_amplitude_rad_s),
            ("g", trace.time_s, trace.torque_amplitude_nm),
            ("h", pair.time_s, 1e3 * mean_deviation(result)),
        ):
            curve(drawn[name], 1e3 * (time - start), values, colour)
    draw_miv_limits(drawn["b"])
    for name, title in (
        ("a", "Load inertia, kg·m²"),
        ("b", "Inertia variation, kg·m²"),
        ("c", "Error, kg·m²"),
        ("d", "Position deviation, mrad"),
        ("e", "Motor angle, rad"),
        ("f", "Denoised speed, its amplitude, rad/s"),
        ("g", "Denoised torque, its amplitude, N·m"),
        ("h", "Position deviation, mean over one period, mrad"),
    ):
        drawn[name].set_title(f"{name}  {title}")
    drawn["a"].set_ylim(0, 0.22)
    drawn["b"].set_ylim(0, 0.1)
    legend(drawn["a"])
    drawn.same_x("abc", "load angle, rad")
    drawn["f"].set_ylim(0, None)
    drawn["g"].set_ylim(0, None)
    drawn.same_x("efgh", "time since start, ms")
    drawn["d"].set_xlabel("time since start, ms")
    drawn["h"].set_ylim(-1, 1)
    for name in "dh":
        drawn[name].set_xlim(-40, 380)
    errors = "; ".join(f"{named(case)} {result_of(case).errors}" for case, _ in SHORTER)
    variation = ", ".join(f"{result_of(case).miv_kgm2:.3f}" for case, _ in SHORTER)
    return Reproduced(
        title="Figure 14: the denoised method at 300, 250 and 200 ms, 50 Hz, 20 % of T_max",
        paper="RMSE 0.0068, 0.0059 and 0.0070 kg·m²; MIV climbs above 0.05 at 200 ms, and the position deviation shows "
        "local deviations there.",
        here=f"{errors}. MIV {variation} kg·m².",
        difference="our errors are smaller: the simulated machine is exactly what the inversion believes it to be, and "
        "only the filter's lag, the changing inertia and noise are left. The gains are those of Figure 13.",
        figure=drawn.figure,
    )


PAPER_TABLE_2 = (
    (REFERENCE, "former", "0.0073", "0.0066", "0.0224"),
    (Case(0.30), "denoised", "0.0068", "0.0054", "0.0160"),
    (Case(0.25), "denoised", "0.0059", "0.0058", "0.0150"),
    (Case(0.20), "denoised", "0.0070", "0.0069", "0.0185"),
)


def table_2() -> Reproduced:
    """RMSE, σ and largest error: the paper's, ours by both inversions, and the GDFT's."""
    lines = [
        "| case | t_RtR | paper: RMSE | σ | max | here: RMSE | σ | max | MIV | RMSE, complex inversion | RMSE, GDFT |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for case, method, *printed in PAPER_TABLE_2:
        found = result_of(case, method)
        e, other = found.errors, result_of(case, method, "complex").errors.rmse_kgm2
        generalised = f"{result_of(case, 'gdft').errors.rmse_kgm2:.4f}" if method != "former" else "–"
        ours = (f"{value:.4f}" for value in (e.rmse_kgm2, e.sigma_kgm2, e.max_kgm2))
        cells = (method, named(case), *printed, *ours, f"{found.miv_kgm2:.3f}", f"{other:.4f}", generalised)
        lines.append(f"| {' | '.join(cells)} |")
    former, halved = result_of(REFERENCE, "former").errors, result_of(Case(0.25)).errors
    late = result_of(Case(0.20)).miv_kgm2
    return Reproduced(
        title="Table 2: error of the estimates, kg·m²",
        paper="the denoised method at 250 ms is better than the former one at 500 ms (RMSE 0.0059 against 0.0073); MIV "
        "is above 0.05 at 200 ms.",
        here=f"the same order: {halved.rmse_kgm2:.4f} against {former.rmse_kgm2:.4f}; MIV {late:.3f} at 200 ms.",
        difference=_gains_used()
        + ". Both inversions agree, as 50 Hz lies below the anti-resonance at every angle. The "
        "RMSE of the denoised method is two to four times smaller than on the paper's machine, and grows as the motion "
        "gets shorter, where theirs does not: there the machine's own deviations from the model weigh more than the "
        "filter.",
        table="\n".join(lines),
    )
