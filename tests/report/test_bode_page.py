"""The page and the picture of a frequency response."""

import numpy as np
import pytest

from schwung.drivetrain import Control, paper_machine
from schwung.drivetrain.response import torque_to_speed
from schwung.estimation.bode import fit_bode
from schwung.estimation.proposal import Stroke, propose
from schwung.estimation.response import Response
from schwung.report.bode import BodeContent, angle_rows, parameter_rows, render_bode, write_bode_report
from schwung.report.figures_bode import bode_figure, proposal_figure
from schwung.session import Session

GAINS = Control(
    position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=20e-3, sample_rate_hz=8000.0
)
MACHINE = paper_machine().model_copy(update={"control": GAINS, "name": "<b>Crank</b>"})
SESSION = Session(runs=(), created="2026-01-01T00:00:00+00:00", source="test")


@pytest.fixture(scope="module")
def fit():
    rng, f = np.random.default_rng(0), np.geomspace(8, 450, 40)
    responses = []
    for angle, load in ((0.0, 0.055), (np.pi / 2, 0.16)):
        exact = torque_to_speed(MACHINE, load, f)
        std = 0.01 * np.abs(exact)
        error = std * (rng.normal(size=40) + 1j * rng.normal(size=40)) / np.sqrt(2)
        ones = np.ones(40)
        responses.append(
            Response(angle, f, exact + error, std, ones, 0j * ones, 1e-3 * ones, 1000.0, None, 8)
        )
    return fit_bode(responses, MACHINE)


def test_every_point_is_drawn_and_those_that_were_not_fitted_as_crosses(fit):
    magnitude, phase, coherence = bode_figure(fit).axes
    circles = [line for line in magnitude.lines if line.get_marker() == "o"]
    crosses = [line for line in magnitude.lines if line.get_marker() == "x"]
    used = [int(response.used.sum()) for response in fit.responses]
    assert [line.get_xdata().size for line in circles] == used
    assert [line.get_xdata().size for line in crosses] == [40 - n for n in used]
    assert crosses[0].get_xdata().min() > 400
    fitted = [line for line in magnitude.lines if line.get_xdata().size > 1000]
    for line, load in zip(fitted, (0.055, 0.16), strict=True):
        exact = np.abs(torque_to_speed(MACHINE, load, line.get_xdata()))
        assert line.get_ydata() == pytest.approx(exact, rel=0.05)
    assert len(phase.lines) == 4
    assert coherence.get_xlabel() == "Frequency, Hz"


def test_no_label_is_mathematical_text(fit):
    """A "$" in a name is a dollar; numbers on the axes have to do without."""
    for figure in (bode_figure(fit), proposal_figure(propose(fit, MACHINE, 1000.0))):
        figure.canvas.draw()
        labels = [
            t.get_text() for axes in figure.axes for t in axes.get_xticklabels() + axes.get_yticklabels()
        ]
        assert not any("$" in label for label in labels)
        assert any(label for label in labels)


def test_the_page_says_everything_and_escapes(fit, tmp_path):
    proposal = propose(fit, MACHINE, 1000.0, stroke=Stroke(np.pi, 0.25))
    content = BodeContent(
        f"{MACHINE.name}: response", SESSION, fit, MACHINE, proposal, [("ok", "torque", "fine", "")]
    )
    page = render_bode(content)
    assert "<b>Crank</b>" not in page
    assert "&lt;b&gt;Crank" in page
    for text in (f"{fit.stiffness.value:.5g}", "Preflight", *fit.notes):
        assert text in page
    assert f"{proposal.best.frequency_hz:.4g} Hz" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    path = write_bode_report(content, tmp_path / "report.html")
    assert path.with_name("bode.png").read_bytes().startswith(b"\x89PNG")


def test_rows_show_value_interval_and_belief(fit):
    assert len(angle_rows(fit)) == 2
    rows = {row[0]: row for row in parameter_rows(fit, MACHINE)}
    stiffness = rows["stiffness, N·m/rad"]
    assert stiffness[1:4] == (f"{fit.stiffness.value:.5g}", f"{fit.stiffness.half_width:.2g}", "24963")
    assert all(row[3] == "" for row in parameter_rows(fit, None))
