"""The Modelica model and the MATLAB function of a learned machine: their equations are those of our simulation.

The MATLAB function runs in Octave, where it is. The Modelica text is parsed by pymoca, where it is; what it says is
worked out by the few lines of `_Model` below, which read its functions and equations as they stand.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import exported_machines as machines
import numpy as np
import pytest

from schwung.motion import Array
from schwung.simulators.matlab import write_matlab
from schwung.simulators.modelica import write_modelica

CASES = machines.cases()
CLOSE = 1e-6
#: Runge-Kutta steps per sample, here as in our simulation: dry friction and play have corners that each step meets.
STEPS = {"plain": 2, "friction": 8, "shaft": 5, "rigid, read late": 2, "curves": 8, "rigid, curves": 8}
#: Samples that are compared: plain Python steps through them.
SAMPLES = 400


class _Model:
    """A Modelica model that Schwung wrote, evaluated line by line: enough of the language for what it writes."""

    def __init__(self, text: str) -> None:
        self.known: dict[str, Any] = {
            "size": lambda rows, axis: rows.shape[axis - 1],
            "div": lambda a, b: a // b,
        }
        self.known |= {name: getattr(np, name) for name in ("sin", "cos", "tanh", "exp", "floor")}
        self.known |= {"delay": lambda value, _: value, "abs": abs, "min": min, "max": max}
        functions = re.findall(r"^  function (\w+) \"[^\n]*\n(.*?)^  end \1;", text, re.M | re.S)
        for name, body in functions:
            exec(_as_python(name, body), self.known)
        for name, value in re.findall(r"^  parameter Real (\w+)(?:\([^)]*\))? = (\S+) ", text, re.M):
            self.known[name] = float(value)
        for name, rows in re.findall(r"^  parameter Real (\w+)\[:, [3:]\] = \[(.*?)\]", text, re.M | re.S):
            self.known[name] = _Rows(
                np.array([[float(x) for x in row.split(",")] for row in rows.split(";")])
            )
        start = re.findall(r"^  Real (\w+)\(.*start=(\S+), fixed=true\);", text, re.M)
        self.start = {name: float(value) for name, value in start}
        self.lines = [
            (name, compile(_expression(said), name, "eval"))
            for name, said in re.findall(r"^  (\S+) = (.*?);", text[text.index("\nequation\n") :], re.M)
        ]

    def rates(self, time: float, x: Array, torque: float) -> Array:
        """Rates of the states in the order of `start`; `known` has all other variables afterwards."""
        self.known |= dict(zip(self.start, x.tolist(), strict=True), time=time, torque=torque)
        found: dict[str, float] = {}
        for name, code in self.lines:
            value = eval(code, self.known)
            if name.startswith("der("):
                found[name[4:-1]] = value
            else:
                self.known[name] = value
        return np.array([found[name] for name in self.start])


class _Rows:
    """A matrix that counts from 1."""

    def __init__(self, values: Array) -> None:
        self.shape, self.values = values.shape, values.tolist()

    def __getitem__(self, at: tuple[int, int]) -> float:
        return float(self.values[at[0] - 1][at[1] - 1])


def _expression(said: str) -> str:
    return said.replace("^", "**")


def _as_python(name: str, body: str) -> str:
    """One function; each of its lines is a statement."""
    inputs = re.findall(r"input Real (\w+)", body)
    (output,) = re.findall(r"output Real (\w+)", body)
    lines, depth = [f"def {name}({', '.join(inputs)}):"], 1
    for line in body[body.index("algorithm") :].splitlines()[1:]:
        said = _expression(line.strip().rstrip(";"))
        if said.startswith("end ") or said == "else":
            depth -= 1
        if said.startswith("end ") or not said:
            continue
        said = re.sub(r"^while (.*) loop$", r"while \1:", re.sub(r"^if (.*) then$", r"if \1:", said))
        lines.append("    " * depth + ("else:" if said == "else" else said.replace(":=", "=")))
        depth += lines[-1].endswith(":")
    return "\n".join([*lines, f"    return {output}"])


def _run(rates: Callable[[float, Array, float], Array], x: Array, torque: Array, steps: int) -> Array:
    """Classical Runge-Kutta under a torque that is held from sample to sample: states (n, m)."""
    h, states = 1 / machines.RATE_HZ / steps, [x]
    for i, held in enumerate(torque[:-1]):
        for s in range(steps):
            t = machines.TIME[i] + s * h
            k1 = rates(t, x, held)
            k2 = rates(t + h / 2, x + h / 2 * k1, held)
            k3 = rates(t + h / 2, x + h / 2 * k2, held)
            k4 = rates(t + h, x + h * k3, held)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(x)
    return np.array(states)


@pytest.mark.parametrize("name", CASES)
def test_the_modelica_model_moves_as_our_simulation(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    ours = machines.simulated(case, STEPS[name])
    written = write_modelica(case.machine, tmp_path / "Machine.mo", start_rad=machines.START_RAD)
    model = _Model(written.path.read_text(encoding="utf-8"))
    model.known |= {"session_share": case.share, "motion_start_s": machines.leaves_rest_s()}
    x0 = np.array(list(model.start.values()))
    states = _run(model.rates, x0, ours.torque_nm[:SAMPLES], STEPS[name])
    angle, speed = states[:, 0], states[:, 1]
    read, share = angle.copy(), np.ones(SAMPLES)
    for error, default in (("eccentricity", 1.0), ("harmonic", 0.0)):
        amplitude, phase = (model.known.get(f"{error}_{key}", 0.0) for key in ("rad", "phase_rad"))
        order = model.known.get(f"{error}_order", default)
        read += amplitude * np.sin(order * angle + phase)
        share += amplitude * order * np.cos(order * angle + phase)
    assert machines.apart(read, ours.position_rad[:SAMPLES]) < CLOSE
    if name != "rigid, read late":
        assert machines.apart(speed * share, ours.speed_rad_s[:SAMPLES]) < CLOSE


@pytest.mark.parametrize("name", CASES)
def test_the_modelica_text_is_modelica(name: str, tmp_path: Path) -> None:
    parser = pytest.importorskip("pymoca.parser")
    text = write_modelica(CASES[name].machine, tmp_path / "Machine.mo").path.read_text(encoding="utf-8")
    assert "Machine" in parser.parse(text).classes
    with pytest.raises(Exception, match="input"):
        parser.parse(text.replace("equation\n", "equation\n  x = ;\n"))


OCTAVE = """\
p = machine();
if isfield(p, 'session_share') p.session_share = {share}; end
if isfield(p, 'motion_start_s') p.motion_start_s = {start}; end
torque = [{torque}];
x = p.x0; h = {step}; read = zeros(numel(torque), 2);
for i = 1:numel(torque)
  [~, y] = machine(0, x, torque(i), p); read(i, :) = y';
  for s = 1:{steps}
    t = (i - 1)*{steps}*h + (s - 1)*h;
    k1 = machine(t, x, torque(i), p);
    k2 = machine(t + h/2, x + h/2*k1, torque(i), p);
    k3 = machine(t + h/2, x + h/2*k2, torque(i), p);
    k4 = machine(t + h, x + h*k3, torque(i), p);
    x = x + h/6*(k1 + 2*k2 + 2*k3 + k4);
  end
end
printf('%.17g %.17g\\n', read');
"""


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="no octave-cli")
@pytest.mark.parametrize("name", ["friction", "shaft", "curves"])
def test_the_matlab_function_moves_as_our_simulation(name: str, tmp_path: Path) -> None:
    case, samples = (
        CASES[name],
        80,
    )  # it leaves its rest by then; further the same text goes in Modelica, above
    ours = machines.simulated(case, STEPS[name])
    write_matlab(case.machine, tmp_path / "machine.m", start_rad=machines.START_RAD)
    script = OCTAVE.format(
        share=case.share,
        start=machines.leaves_rest_s(),
        torque=" ".join(repr(float(x)) for x in ours.torque_nm[:samples]),
        step=1 / machines.RATE_HZ / STEPS[name],
        steps=STEPS[name],
    )
    (tmp_path / "compare.m").write_text(script, encoding="utf-8")
    done = subprocess.run(
        ["octave-cli", "--norc", "compare.m"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    read = np.array([[float(x) for x in line.split()] for line in done.stdout.splitlines()])
    assert machines.apart(read[:, 0], ours.position_rad[:samples]) < CLOSE
    assert machines.apart(read[:, 1], ours.speed_rad_s[:samples]) < CLOSE
