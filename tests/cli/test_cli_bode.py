"""`schwung bode` on a recorded session, and its mistakes."""

import json

import numpy as np
import pytest
from cli_running import invoke

from schwung.drivetrain import Control, load_machine, paper_machine, simulate, write_machine
from schwung.motion import Demand, Excitation
from schwung.session import Run, SessionWriter

LINES = np.unique(np.rint(np.geomspace(10, 500, 30) / 5)) * 5


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """A machine file and a session of it: the simulated drive at standstill, generator's sine, sampled at 4 kHz."""
    folder = tmp_path_factory.mktemp("bode")
    control = Control(
        position_gain_per_s=40.0, speed_gain_nms=12.0, speed_integral_time_s=20e-3, sample_rate_hz=8000.0
    )
    machine = paper_machine().model_copy(update={"control": control})
    phases = np.random.default_rng(0).uniform(-np.pi, np.pi, LINES.size)
    excitation = Excitation(
        waveform="multisine", frequency_hz=5.0, amplitude_nm=60.0, frequencies_hz=tuple(LINES),
        amplitudes_nm=tuple(2.0 * np.minimum(1, LINES / 40)), phases_rad=tuple(phases), ramp_s=0.05,
        settle_s=0.5, end_s=1.3,
    )  # fmt: skip
    time, fine = np.arange(5201) / 4000, np.arange(10401) / 8000
    rest = np.zeros_like(fine)
    rng = np.random.default_rng(1)
    with SessionWriter(folder / "session.h5", source="simulated") as writer:
        for number, angle in enumerate((0.3, 1.5)):
            made = simulate(
                machine,
                Demand(rest, rest, rest),
                fine,
                excitation.torque(fine),
                inertia=_inertia(machine, angle),
            )
            writer.append(
                Run("excited", number, 4000.0, time, made.position_rad[::2] + angle,
                    made.speed_rad_s[::2] + 1e-3 * rng.normal(size=time.size),
                    made.torque_nm[::2] + 0.02 * rng.normal(size=time.size), excitation=excitation)
            )  # fmt: skip
    write_machine(machine, folder / "machine.toml")
    return folder


def _inertia(machine, angle):
    return float(machine.load_inertia_at(np.array([angle]))[0])


def test_a_recorded_session_gives_numbers_a_proposal_and_files(places, tmp_path, capsys):
    code, out, _ = invoke(
        capsys, "bode", "-m", str(places / "machine.toml"), "--session", str(places / "session.h5"),
        "--out", str(tmp_path / "out"), "--duration", "150ms", "--json",
    )  # fmt: skip
    assert code == 0
    result = json.loads(out)
    truth = paper_machine()
    stiffness = result["parameters"]["stiffness_nm_rad"]
    assert stiffness["value"] == pytest.approx(24963, rel=0.01)
    for angle, position in zip(result["angles"], (0.3, 1.5), strict=True):
        assert angle["inertia_kgm2"]["value"] == pytest.approx(_inertia(truth, position), rel=0.02)
    frequency = result["proposal"]["frequency_hz"]
    assert 4000 / frequency == pytest.approx(round(4000 / frequency))
    fitted = load_machine(tmp_path / "out" / "machine.toml")
    assert fitted.coupling.stiffness_nm_rad == pytest.approx(stiffness["value"])
    assert (tmp_path / "out" / "bode.png").stat().st_size > 10_000
    assert "Anti-resonance" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "--angles"),
        (("--angles", "0", "--session", "x.h5"), "--angles"),
        (("--angles", "0,many"), "many"),
        (("--angles", "0", "--waveform", "square"), "multisine"),
        (("--session", "missing.h5"), "missing.h5"),
    ],
)
def test_mistakes_are_one_sentence(places, capsys, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    code, _, err = invoke(capsys, "bode", "-m", str(places / "machine.toml"), *arguments)
    assert code == 2
    assert words in err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def test_help_has_examples(capsys):
    code, out, _ = invoke(capsys, "bode", "--help")
    assert code == 0
    assert "--angles 0,90deg,180deg" in " ".join(out.split())
