"""FMUs as others make them, for tests: small C models of their own, for model exchange, inverse, or broken on purpose.

None of it is Schwung's C: the two-mass machine and the rigid inverse are written here from method.md (1), in units and
names that a stranger might use.
"""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from dataclasses import dataclass
from pathlib import Path

import fmpy

_HEAD = """\
#include <stddef.h>
#include <stdlib.h>
#include <math.h>
typedef struct { double v[16]; double t; } M;
#define F __attribute__((visibility("default")))
F const char *fmi2GetTypesPlatform(void) { return "default"; }
F const char *fmi2GetVersion(void) { return "2.0"; }
F int fmi2SetDebugLogging(void *c, int o, size_t n, const char *const k[]) { return 0; }
static void begin(M *m);
F void *fmi2Instantiate(const char *n, int t, const char *g, const char *r, const void *k, int v, int l) {
  M *m = calloc(1, sizeof *m); begin(m); return m; }
F void fmi2FreeInstance(void *c) { free(c); }
F int fmi2SetupExperiment(void *c, int d, double t, double s, int e, double x) { ((M *)c)->t = s; return 0; }
F int fmi2EnterInitializationMode(void *c) { return 0; }
F int fmi2ExitInitializationMode(void *c) { return 0; }
F int fmi2Terminate(void *c) { return 0; }
F int fmi2Reset(void *c) { return 0; }
static void output(M *m);
F int fmi2GetReal(void *c, const unsigned r[], size_t n, double x[]) {
  output(c); for (size_t i = 0; i < n; i++) x[i] = ((M *)c)->v[r[i]]; return 0; }
F int fmi2SetReal(void *c, const unsigned r[], size_t n, const double x[]) {
  for (size_t i = 0; i < n; i++) ((M *)c)->v[r[i]] = x[i]; return 0; }
"""

#: What FMI wants to be there, and nobody calls.
_UNUSED = """\
GetInteger GetBoolean GetString SetInteger SetBoolean SetString GetFMUstate SetFMUstate FreeFMUstate
SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate GetDirectionalDerivative SetRealInputDerivatives
GetRealOutputDerivatives CancelStep GetStatus GetRealStatus GetIntegerStatus GetBooleanStatus GetStringStatus
"""
_REST = "".join(f"F int fmi2{name}() {{ return 3; }}\n" for name in _UNUSED.split())

#: Two masses on a spring without friction: angle in degrees, speed in rpm, torque counted the other way round.
_TWO_MASSES = """\
enum { TAU, PHI, N };
static double s[4];
static void begin(M *m) { s[0] = s[1] = s[2] = s[3] = 0; }
static double inertia(double a) { return %(base)r + %(swing)r * sin(a) * sin(a); }
static double slope(double a) { return 2 * %(swing)r * sin(a) * cos(a); }
static void rates(M *m, const double x[4], double dx[4]) {
  double c = %(k)r * (x[0] - x[2]) + %(d)r * (x[1] - x[3]);
  dx[0] = x[1]; dx[1] = (-m->v[TAU] - c) / %(rotor)r;
  dx[2] = x[3]; dx[3] = (c - 0.5 * slope(x[2]) * x[3] * x[3]) / inertia(x[2]);
}
static void output(M *m) { m->v[PHI] = s[0] * 57.29577951308232; m->v[N] = s[1] * 9.549296585513721; }
F int fmi2SetTime(void *c, double t) { ((M *)c)->t = t; return 0; }
static int copy(double *to, const double *from, size_t n) { for (size_t i = 0; i < n; i++) to[i] = from[i]; return 0; }
F int fmi2SetContinuousStates(void *c, const double x[], size_t n) { return copy(s, x, n); }
F int fmi2GetContinuousStates(void *c, double x[], size_t n) { return copy(x, s, n); }
F int fmi2GetDerivatives(void *c, double x[], size_t n) { rates(c, s, x); return 0; }
F int fmi2GetNominalsOfContinuousStates(void *c, double x[], size_t n) {
  for (size_t i = 0; i < n; i++) x[i] = 1;
  return 0; }
F int fmi2GetEventIndicators(void *c, double x[], size_t n) { return 0; }
F int fmi2EnterEventMode(void *c) { return 0; }
F int fmi2EnterContinuousTimeMode(void *c) { return 0; }
F int fmi2NewDiscreteStates(void *c, int *info) { for (int i = 0; i < 5; i++) info[i] = 0; return 0; }
F int fmi2CompletedIntegratorStep(void *c, int no, int *e, int *t) { *e = *t = 0; return 0; }
"""

#: A rigid machine the other way round: motion in, torque out.
_INVERSE = """\
enum { A, W, ALPHA, TAU };
static void begin(M *m) { }
static void output(M *m) {
  double a = m->v[A], j = %(rotor)r + %(base)r + %(swing)r * sin(a) * sin(a), dj = 2 * %(swing)r * sin(a) * cos(a);
  m->v[TAU] = j * m->v[ALPHA] + 0.5 * dj * m->v[W] * m->v[W]; }
F int fmi2DoStep(void *c, double t, double h, int n) { return 0; }
"""

#: One that crashes in its third step, one that never comes back, and one that gives no numbers.
_BROKEN = """\
enum { TAU, PHI, W };
static int steps;
static void begin(M *m) { steps = 0; }
static void output(M *m) { m->v[PHI] = 1e-3 * m->v[TAU]; m->v[W] = m->v[TAU]; }
F int fmi2DoStep(void *c, double t, double h, int n) { if (++steps == 3) { %(how)s } return 0; }
"""
CRASH = "*(volatile int *)0 = 1;"
NO_NUMBER = "((M *)c)->v[TAU] = NAN;"
FAILS = "return 3;"


@dataclass(frozen=True)
class Plant:
    """Two masses with J_l = base + swing·sin²θ; SI."""

    rotor: float = 0.012
    base: float = 0.055
    swing: float = 0.1
    k: float = 24963.0
    d: float = 8.62


_UNIT, _START = ' unit="{}"', ' start="0"'


def _described(name: str, interface: str, variables: tuple[tuple[str, str, str], ...], states: int) -> str:
    listed = "\n".join(
        f'<ScalarVariable name="{n}" valueReference="{i}" causality="{c}" variability="continuous">'
        f"<Real{_UNIT.format(u) if u else ''}{_START if c == 'input' else ''}/></ScalarVariable>"
        for i, (n, c, u) in enumerate(variables)
    )
    listed += "".join(
        f'<ScalarVariable name="x{i}" valueReference="{8 + 2 * i}" causality="local"><Real/></ScalarVariable>'
        f'<ScalarVariable name="der(x{i})" valueReference="{9 + 2 * i}" causality="local">'
        f'<Real derivative="{len(variables) + 2 * i + 1}"/></ScalarVariable>'
        for i in range(states)
    )
    slopes = "".join(f'<Unknown index="{len(variables) + 2 * i + 2}"/>' for i in range(states))
    return (
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{{g}}" numberOfEventIndicators="0">'
        f'<{interface} modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{listed}</ModelVariables>"
        f"<ModelStructure><Derivatives>{slopes}</Derivatives></ModelStructure></fmiModelDescription>"
    )


def _packed(folder: Path, name: str, code: str, description: str) -> Path:
    compiler = next(found for one in ("cc", "gcc", "clang") if (found := shutil.which(one)))
    source, library = folder / f"{name}.c", folder / f"{name}.so"
    source.write_text(_HEAD + code + _REST, encoding="utf-8")
    subprocess.run(
        [compiler, "-O1", "-w", "-shared", "-fPIC", "-o", str(library), str(source), "-lm"], check=True
    )
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{fmpy.platform}/{name}{fmpy.sharedLibraryExtension}")
    return path


def two_masses(folder: Path, plant: Plant) -> Path:
    """For model exchange: `tau` (N.m, the other way round) in, `phi` (deg) and `n` (rpm, unsaid) out."""
    variables = (("tau", "input", "N.m"), ("phi", "output", "deg"), ("n", "output", ""))
    description = _described("two_masses", "ModelExchange", variables, states=4)
    return _packed(folder, "two_masses", _TWO_MASSES % vars(plant), description)


def inverse(folder: Path, plant: Plant) -> Path:
    """For co-simulation: motion `a`, `w`, `alpha` in, torque `tau` out, of the rigid machine."""
    variables = (
        ("a", "input", "rad"),
        ("w", "input", "rad/s"),
        ("alpha", "input", "rad/s2"),
        ("tau", "output", "N.m"),
        ("brake", "input", "N.m"),
    )
    return _packed(
        folder, "inverse", _INVERSE % vars(plant), _described("inverse", "CoSimulation", variables, 0)
    )


def broken(folder: Path, how: str) -> Path:
    """For co-simulation: `tau` in, `phi` and `w` out, until it breaks."""
    variables = (("tau", "input", "N.m"), ("phi", "output", "rad"), ("w", "output", "rad/s"))
    return _packed(
        folder, "broken", _BROKEN % {"how": how}, _described("broken", "CoSimulation", variables, 0)
    )
