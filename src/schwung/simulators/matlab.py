"""A machine as one MATLAB function for ode45 and its like; runs in GNU Octave, too, and needs no toolbox."""

from __future__ import annotations

import re
from pathlib import Path

from schwung.drivetrain.machine import Machine
from schwung.files import replace_file
from schwung.motion import Array
from schwung.simulators.equations import Equations, equations
from schwung.simulators.exported import Exported, exported, file_name
from schwung.simulators.modelica import WrittenModel

_FUNCTIONS = {
    "curve_value": """\
function value = curve_value(rows, angle)
% A curve through rows of angle, value and slope: cubic between them, constant beyond.
  [u, c] = piece(rows, min(max(angle, rows(1, 1)), rows(end, 1)));
  value = ((c(1)*u + c(2))*u + c(3))*u + c(4);
end
""",
    "plane_value": """\
function value = plane_value(rows, x, y)
% A table over two coordinates: bilinear, constant beyond; first row and column are the points.
  x = min(max(x, rows(2, 1)), rows(end, 1));
  y = min(max(y, rows(1, 2)), rows(1, end));
  i = min(1 + sum(rows(2:end, 1) <= x), size(rows, 1) - 1);
  j = min(1 + sum(rows(1, 2:end) <= y), size(rows, 2) - 1);
  u = (x - rows(i, 1))/(rows(i + 1, 1) - rows(i, 1));
  v = (y - rows(1, j))/(rows(1, j + 1) - rows(1, j));
  low = (1 - u)*rows(i, j) + u*rows(i + 1, j);
  high = (1 - u)*rows(i, j + 1) + u*rows(i + 1, j + 1);
  value = (1 - v)*low + v*high;
end
""",
    "curve_slope": """\
function slope = curve_slope(rows, angle)
% Slope of the same curve: 0 beyond its ends.
  slope = 0;
  if angle >= rows(1, 1) && angle <= rows(end, 1)
    [u, c] = piece(rows, angle);
    slope = (3*c(1)*u + 2*c(2))*u + c(3);
  end
end
""",
    "piece": """\
function [u, c] = piece(rows, angle)
% Where in its piece of the curve an angle is, and the piece's cubic.
  low = max(1, min(sum(rows(:, 1) <= angle), size(rows, 1) - 1));
  a = rows(low, :);
  b = rows(low + 1, :);
  width = b(1) - a(1);
  secant = (b(2) - a(2))/width;
  u = angle - a(1);
  c = [(a(3) + b(3) - 2*secant)/width^2, (3*secant - 2*a(3) - b(3))/width, a(3), a(2)];
end
""",
    "accelerated": """\
function a = accelerated(rows, torque, inertia)
% Acceleration a with inertia*a = torque + curve(a): Newton.
  a = torque/inertia;
  for i = 1:8
    a = a + (torque + curve_value(rows, a) - inertia*a)/max(inertia - curve_slope(rows, a), 0.1*inertia);
  end
end
""",
    "bump": """\
function height = bump(share, sharpness)
% 1 in the middle of 0..1, 0 at the ends and beyond: a raised cosine to a power.
  height = 0;
  if share > 0 && share < 1
    height = (0.5*(1 - cos(2*pi*share)))^sharpness;
  end
end
""",
    "sided": """\
function value = sided(speed, positive, negative)
% One value for either direction.
  value = negative;
  if speed > 0
    value = positive;
  end
end
""",
    "away_from": """\
function away = away_from(angle, centre)
% Angle from a centre that comes back every turn.
  away = angle - centre;
  away = away - 2*pi*floor(away/(2*pi) + 0.5);
end
""",
    "drifted": """\
function drift = drifted(share, settling)
% Share of a drift after a share of the session: evenly, or settling.
  drift = share;
  if abs(settling) >= 0.001
    drift = expm1(-settling*share)/expm1(-settling);
  end
end
""",
    "push": """\
function torque = push(twist, twist_speed, stiffness, damping, cubic, gap)
% Torque of a coupling with play, which can only push.
  wound = abs(twist) - 0.5*gap;
  side = 1 - 2*(twist <= 0);
  torque = 0;
  if wound > 0
    torque = side*max((stiffness + cubic*wound^2)*wound + damping*side*twist_speed, 0);
  end
end
""",
}


def write_matlab(machine: Machine, path: str | Path, *, start_rad: float | None = None) -> WrittenModel:
    """Write a machine as a MATLAB function `[rates, read] = NAME(time, x, torque, p)`; the file's name is NAME.

    Arguments and errors are those of `write_fmu`; InputError, too, where the file's name is none of a function.
    """
    path = Path(path)
    name = file_name(path, ".m", "MATLAB function")
    replace_file(path, matlab(exported(machine, start_rad), name))
    return WrittenModel(path, name)


def matlab(told: Exported, name: str) -> str:
    """The function's text."""
    of = equations(told)
    body = "\n".join(one.expression for one in of.lines)
    helpers = [text for helper, text in _FUNCTIONS.items() if helper == "piece" or f"{helper}(" in body]
    known = re.compile(
        rf"\b({'|'.join([*(one.name for one in of.parameters), *(f'{t}_rows' for t in told.tables), *told.planes])})\b"
    )

    def said(expression: str) -> str:
        return known.sub(r"p.\1", expression)

    lines = [
        f"function [rates, read] = {name}(time, x, torque, p)",
        *(f"% {line}".rstrip() for line in _head(told, of, name)),
        "  if nargin == 0",
        "    rates = parameters();",
        "    return",
        "  end",
        "  if nargin < 4",
        "    p = parameters();",
        "  end",
        *(f"  {state} = x({place});" for place, state in enumerate(of.states, 1)),
        *(
            f"  {'d_' if one.derivative else ''}{one.name} = {said(one.expression)};"
            + (f"  % {one.comment}" if one.comment else "")
            for one in of.lines
        ),
        f"  rates = [{'; '.join(f'd_{state}' for state in of.states)}];",
        f"  read = [{said(of.read_angle)}; {said(of.read_speed)}];",
        "end",
        "",
        "function p = parameters()",
        *(
            f"  p.{one.name} = {one.value!r};  % {one.unit or '-'}: {one.description}"
            for one in of.parameters
        ),
        *(_matrix(f"p.{table}_rows", rows) for table, rows in told.tables.items() if f"{table}_rows" in body),
        *(
            _matrix(f"p.{table}", rows, "points above and at the left, torque (N.m)")
            for table, rows in told.planes.items()
            if table in body
        ),
        f"  p.x0 = [{'; '.join(repr(told.at_rest[state]) for state in of.states)}];",
        "end",
        "",
        "\n".join(helpers),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _head(told: Exported, of: Equations, name: str) -> list[str]:
    late = [
        "The drive reads the speed p.speed_delay_s later than it is: move it by that in what you compare."
    ]
    return [
        f"{told.name.splitlines()[0]}: motor, coupling and load as learned by Schwung. SI units.",
        f"  x: {', '.join(of.states)}",
        "  torque: motor torque as the drive reports it, N.m",
        "  rates: dx/dt;  read: angle (rad) and speed (rad/s) of the motor as the drive reads them",
        f"  p = {name}() gives the parameters, which may be changed; p.x0 is the standstill.",
        *(late if of.delayed else []),
        "",
        "Half a second under a torque that goes up and down, from standstill:",
        "",
        f"  p = {name}();",
        "  torque = @(t) 5*sin(2*pi*2*t);",
        f"  [t, x] = ode45(@(t, x) {name}(t, x, torque(t), p), [0 0.5], p.x0, odeset('RelTol', 1e-8, 'AbsTol', 1e-9));",
        "  plot(t, x(:, 1)), xlabel('time, s'), ylabel('motor angle, rad')",
    ]


def _matrix(name: str, rows: Array, words: str = "angle (rad), value, slope") -> str:
    held = "\n".join(f"    {', '.join(repr(x) for x in row)}" for row in rows.tolist())
    return f"  {name} = [  % {words}\n{held}\n  ];"
