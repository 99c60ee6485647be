"""A machine as one readable Modelica model (Modelica 3.4 and later) that needs no library."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from schwung.drivetrain.machine import Machine
from schwung.files import replace_file
from schwung.motion import Array
from schwung.simulators.equations import Equations, equations
from schwung.simulators.exported import UNITS, Exported, exported, file_name

_FUNCTIONS = {
    "curve_value": """\
  function curve_value "A curve through rows of angle, value and slope: cubic between them, constant beyond"
    input Real rows[:, 3];
    input Real angle;
    output Real value;
  protected
    Integer low;
    Integer high;
    Integer middle;
    Real inside;
    Real width;
    Real u;
    Real secant;
    Real square;
    Real cube;
  algorithm
    low := 1;
    high := size(rows, 1);
    inside := min(max(angle, rows[low, 1]), rows[high, 1]);
    while high - low > 1 loop
      middle := div(low + high, 2);
      if inside < rows[middle, 1] then
        high := middle;
      else
        low := middle;
      end if;
    end while;
    width := rows[high, 1] - rows[low, 1];
    u := inside - rows[low, 1];
    secant := (rows[high, 2] - rows[low, 2])/width;
    square := (3*secant - 2*rows[low, 3] - rows[high, 3])/width;
    cube := (rows[low, 3] + rows[high, 3] - 2*secant)/width^2;
    value := ((cube*u + square)*u + rows[low, 3])*u + rows[low, 2];
  end curve_value;
""",
    "plane_value": """\
  function plane_value "A table over two coordinates: bilinear, constant beyond; first row and column are the points"
    input Real rows[:, :];
    input Real x;
    input Real y;
    output Real value;
  protected
    Integer i;
    Integer j;
    Real inside;
    Real across;
    Real u;
    Real v;
  algorithm
    inside := min(max(x, rows[2, 1]), rows[size(rows, 1), 1]);
    across := min(max(y, rows[1, 2]), rows[1, size(rows, 2)]);
    i := 2;
    while i < size(rows, 1) - 1 and rows[i + 1, 1] <= inside loop
      i := i + 1;
    end while;
    j := 2;
    while j < size(rows, 2) - 1 and rows[1, j + 1] <= across loop
      j := j + 1;
    end while;
    u := (inside - rows[i, 1])/(rows[i + 1, 1] - rows[i, 1]);
    v := (across - rows[1, j])/(rows[1, j + 1] - rows[1, j]);
    value := (1 - v)*((1 - u)*rows[i, j] + u*rows[i + 1, j]) + v*((1 - u)*rows[i, j + 1] + u*rows[i + 1, j + 1]);
  end plane_value;
""",
    "curve_slope": """\
  function curve_slope "Slope of the same curve: 0 beyond its ends"
    input Real rows[:, 3];
    input Real angle;
    output Real slope;
  protected
    Integer low;
    Integer high;
    Integer middle;
    Real width;
    Real u;
    Real secant;
    Real square;
    Real cube;
  algorithm
    low := 1;
    high := size(rows, 1);
    slope := 0;
    if angle >= rows[low, 1] and angle <= rows[high, 1] then
      while high - low > 1 loop
        middle := div(low + high, 2);
        if angle < rows[middle, 1] then
          high := middle;
        else
          low := middle;
        end if;
      end while;
      width := rows[high, 1] - rows[low, 1];
      u := angle - rows[low, 1];
      secant := (rows[high, 2] - rows[low, 2])/width;
      square := (3*secant - 2*rows[low, 3] - rows[high, 3])/width;
      cube := (rows[low, 3] + rows[high, 3] - 2*secant)/width^2;
      slope := (3*cube*u + 2*square)*u + rows[low, 3];
    end if;
  end curve_slope;
""",
    "accelerated": """\
  function accelerated "Acceleration a with inertia*a = torque + curve(a): Newton"
    input Real rows[:, 3];
    input Real torque;
    input Real inertia;
    output Real a;
  protected
    Integer step;
  algorithm
    a := torque/inertia;
    step := 0;
    while step < 8 loop
      a := a + (torque + curve_value(rows, a) - inertia*a)/max(inertia - curve_slope(rows, a), 0.1*inertia);
      step := step + 1;
    end while;
  end accelerated;
""",
    "bump": """\
  function bump "1 in the middle of 0..1, 0 at the ends and beyond: a raised cosine to a power"
    input Real share;
    input Real sharpness;
    output Real height;
  algorithm
    height := 0;
    if share > 0 and share < 1 then
      height := (0.5*(1 - cos(6.283185307179586*share)))^sharpness;
    end if;
  end bump;
""",
    "sided": """\
  function sided "One value for either direction"
    input Real speed;
    input Real positive;
    input Real negative;
    output Real value;
  algorithm
    value := negative;
    if speed > 0 then
      value := positive;
    end if;
  end sided;
""",
    "away_from": """\
  function away_from "Angle from a centre that comes back every turn"
    input Real angle;
    input Real centre;
    output Real away;
  algorithm
    away := angle - centre;
    away := away - 6.283185307179586*floor(away/6.283185307179586 + 0.5);
  end away_from;
""",
    "drifted": """\
  function drifted "Share of a drift after a share of the session: evenly, or settling"
    input Real share;
    input Real settling;
    output Real drift;
  algorithm
    drift := share;
    if abs(settling) >= 0.001 then
      drift := (1 - exp(-settling*share))/(1 - exp(-settling));
    end if;
  end drifted;
""",
    "push": """\
  function push "Torque of a coupling with play, which can only push"
    input Real twist;
    input Real twist_speed;
    input Real stiffness;
    input Real damping;
    input Real cubic;
    input Real gap;
    output Real torque;
  protected
    Real wound;
    Real side;
  algorithm
    wound := abs(twist) - 0.5*gap;
    side := -1;
    if twist > 0 then
      side := 1;
    end if;
    torque := 0;
    if wound > 0 then
      torque := side*max((stiffness + cubic*wound^2)*wound + damping*side*twist_speed, 0);
    end if;
  end push;
""",
}


@dataclass(frozen=True)
class WrittenModel:
    """A model that was written."""

    path: Path
    name: str


def write_modelica(machine: Machine, path: str | Path, *, start_rad: float | None = None) -> WrittenModel:
    """Write a machine as a Modelica model: input torque (N·m), outputs angles (rad) and speeds (rad/s).

    The model is named as the file. Arguments and errors are those of `write_fmu`; InputError, too, where the file's
    name is none of a model.
    """
    path = Path(path)
    name = file_name(path, ".mo", "Modelica model")
    replace_file(path, modelica(exported(machine, start_rad), name))
    return WrittenModel(path, name)


def modelica(told: Exported, name: str) -> str:
    """The model's text."""
    of = equations(told)
    text = "\n".join(f"{one.name} {one.expression}" for one in of.lines)
    comment = told.name.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    lines = [
        f'model {name} "{comment}"',
        "  // Motor, coupling and load with an inertia over its angle, as learned by Schwung. SI units.",
        *(_declared("parameter", one.name, one.value, one.description) for one in of.parameters),
        *(_matrix(f"{name}_rows", rows) for name, rows in told.tables.items() if f"{name}_rows" in text),
        *(_matrix(table, rows, ":, :") for table, rows in told.planes.items() if table in text),
        '  input Real torque(unit="N.m") "motor torque as the drive reports it";',
        '  output Real read_angle(unit="rad") "angle of the motor as the drive reads it";',
        '  output Real read_speed(unit="rad/s") "speed of the motor as the drive reads it";',
        *(_state(told, name) for name in of.states),
        *_algebraic(of),
        *(function for name, function in _FUNCTIONS.items() if f"{name}(" in text),
        "equation",
        *(
            f"  {f'der({one.name})' if one.derivative else one.name} = {one.expression};"
            + (f" // {one.comment}" if one.comment else "")
            for one in of.lines
        ),
        f"  read_angle = {of.read_angle};",
        f"  read_speed = {f'delay({of.read_speed}, speed_delay_s)' if of.delayed else of.read_speed};",
        f"end {name};",
    ]
    return "\n".join(lines) + "\n"


def _declared(kind: str, name: str, value: float, description: str) -> str:
    unit = next((f'(unit="{unit}")' for end, unit in UNITS.items() if name.endswith(end)), "")
    return f'  {kind} Real {name}{unit} = {value!r} "{description}";'


def _matrix(name: str, rows: Array, size: str = ":, 3") -> str:
    held = ";\n    ".join(", ".join(repr(x) for x in row) for row in rows.tolist())
    words = "angle (rad), value, slope" if size == ":, 3" else "points above and at the left, torque (N.m)"
    return f'  parameter Real {name}[{size}] = [\n    {held}] "{words}";'


def _state(told: Exported, name: str) -> str:
    unit = {"speed": "rad/s", "angle": "rad"}.get(name.rpartition("_")[2], "N.m")
    return f'  Real {name}(unit="{unit}", start={told.at_rest[name]!r}, fixed=true);'


def _algebraic(of: Equations) -> list[str]:
    return [f"  Real {one.name};" for one in of.lines if not one.derivative and one.name not in of.states]
