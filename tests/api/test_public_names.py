"""Everything that `import schwung` offers: says units, shapes, errors and an example, and the examples are true."""

import ast
import doctest
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import schwung
from schwung.explain.weighing.values import Parameter, Timing
from schwung.innovations.likelihood import Noise
from schwung_sim.bench import Bench

ERRORS = [name for name in schwung.__all__ if name.endswith("Error") or name == "InterruptedByUser"]
NAMES = [name for name in schwung.__all__ if name not in ERRORS and name != "__version__"]
PAGE = Path(__file__).parents[2] / "docs" / "python.md"
#: A unit, or the word that there is none.
UNIT = re.compile(r"\b(rad|kg·m²|Hz|SI|bit/s|units?)\b|N·m|\bs\b")
#: A shape, or the word that there is none.
SHAPE = re.compile(r"\(n,\)|\bshapes?\b|\bno arrays\b")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What the examples take as given: a drive on a virtual bus, and what the page about Python has left."""
    folder, page = tmp_path_factory.mktemp("api"), PAGE.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert code.count("\n") <= 41  # everything in 40 lines
    made: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch, Bench("two-mass", channel="api", node_id=1):
        patch.chdir(folder)
        patch.setenv("MPLBACKEND", "agg")
        exec(compile(code, str(PAGE), "exec"), made)
        yield made | {
            "bench": "api",
            "folder": folder,
            "session_file": made["done"].session_path.absolute(),
            "explanation": schwung.Explanation(
                axis="rotary",
                effort="torque",
                names=(),
                curves=(),
                runners_up=(),
                noise=Noise(0.1, 0.01, 1e-5),
                excess=1.0,
                timing=Timing(Parameter(0.0, -1e-6, 1e-6), "speed", 7e-5),
                proof=None,
                overlays=(),
                machine=made["believed"],
                notes=(),
            ),
            "table": schwung.InertiaTable(np.array([0.0, 1.0, 2.0]), np.array([0.1, 0.3, 0.2])),
        }


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["plan", "done", "written", "session", "former", "explanation", "simulated", "best"]
)
def test_values_show_themselves(world: dict[str, Any], name: str) -> None:
    value = world[name]
    shown = value._repr_html_()
    assert shown.startswith('<div class="schwung-value">')
    assert "<table>" in shown
    assert "<script" not in shown
    assert "http" not in shown.replace("http://www.w3.org", "")  # nothing is fetched
    if name != "written":
        axes = Figure().subplots()
        assert value.plot(axes) is axes
        assert axes.lines
        assert "<svg" in shown
    if name != "plan":
        assert len(value.to_dataframe().columns) > 2


@pytest.mark.long
def test_without_pandas_one_sentence_says_so(world: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("schwung.api.shown.find_spec", lambda _name: None)
    with pytest.raises(schwung.InputError, match="needs pandas, not installed here"):
        world["session"].to_dataframe()


def test_the_list_is_the_same_for_people_and_for_type_checkers() -> None:
    stub = ast.parse(Path(schwung.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    told = {(n.module, a.name) for n in ast.walk(stub) if isinstance(n, ast.ImportFrom) for a in n.names}
    assert {name for _, name in told} == {*ERRORS, *NAMES}
    for module, name in told:
        assert getattr(schwung, name) is getattr(sys.modules[str(module)], name)
    assert set(dir(schwung)) == set(schwung.__all__)
    assert len(schwung.__all__) < 60


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'estimat'"):
        schwung.estimat  # noqa: B018  # it is the looking that raises


def test_a_room_that_is_called_like_a_verb_does_not_take_its_place() -> None:
    code = (
        "import schwung, schwung.explain, sys; assert schwung.explain is not sys.modules['schwung.explain']"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_importing_loads_nothing() -> None:
    code = "import sys; before = set(sys.modules); import schwung; print(*set(sys.modules) - before)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = done.stdout.split()
    assert [name for name in loaded if name.startswith("schwung")] == ["schwung"]
    assert {name.partition(".")[0] for name in loaded} - {"schwung"} <= set(sys.stdlib_module_names)


@pytest.mark.parametrize("name", NAMES)
def test_every_name_says_units_shapes_errors_and_an_example(name: str) -> None:
    offered = getattr(schwung, name)
    text = inspect.getdoc(offered) or ""
    assert UNIT.search(text), f"{name} says no units"
    assert SHAPE.search(text), f"{name} says no shapes"
    assert "aises" in text, f"{name} says no errors"
    assert ">>> " in text, f"{name} has no example"
    if inspect.isfunction(offered):
        for parameter in inspect.signature(offered).parameters:
            assert re.search(rf"\b{parameter}\b", text), f"{name} does not say what {parameter} is"


@pytest.mark.parametrize("name", ERRORS)
def test_every_error_says_when_it_is_raised(name: str) -> None:
    assert len(inspect.getdoc(getattr(schwung, name)) or "") > 20


@pytest.mark.parametrize("name", NAMES)
def test_examples_are_true(name: str, world: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(world["folder"])
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    offered = inspect.unwrap(getattr(schwung, name))
    (found,) = [
        test
        for test in doctest.DocTestFinder(recurse=False).find(offered, name, globs=dict(world))
        if test.examples
    ]
    said: list[str] = []
    runner.run(found, out=said.append)
    assert runner.failures == 0, "".join(said)
