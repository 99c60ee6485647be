"""Room for all labels, whatever they are: nothing is cut off, nothing lies on another."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure

from schwung.report.style import in_style, key, new_figure, to_svg

X = np.linspace(0.0, 1.0, 50)


@in_style
def _figure(height_in: float, sizes: tuple[float, ...], names: tuple[str, ...] = ()) -> Figure:
    figure = new_figure(height_in, tuple(range(1, len(sizes) + 1)))
    for number, (axes, size) in enumerate(zip(figure.axes, sizes, strict=True)):
        axes.plot(X, size * np.sin(9 * X), label=f"curve {number}")
        axes.set_title(f"Signal {number}, N·m")
        key(axes)
    if names:
        figure.axes[-1].set_yticks(np.linspace(-0.5, 0.5, len(names)) * sizes[-1], names)
    figure.axes[-1].set_xlabel("time, s")
    return figure


@pytest.mark.parametrize(
    ("height_in", "sizes", "names"),
    [
        (2.5, (7.0,), ()),  # has other ticks, and wider ones, in its new height
        (4.0, (1.0, 2.5e-4), ()),
        (4.2, (2e5, 1.0, 0.03), ()),
        (2.6, (1.0,), ("a name of a cause that is rather long", "another")),
    ],
)
def test_all_labels_have_room(height_in: float, sizes: tuple[float, ...], names: tuple[str, ...]) -> None:
    figure = _figure(height_in, sizes, names)
    before = [axes.get_position() for axes in figure.axes]
    assert to_svg(figure, "test", "Test").startswith("<svg")
    assert before != [axes.get_position() for axes in figure.axes]
    boxes = [box for axes in figure.axes if (box := axes.get_tightbbox(for_layout_only=True)) is not None]
    assert len(boxes) == len(sizes)
    for upper, lower in pairwise(boxes):
        assert upper.y0 >= lower.y1 - 1
    for box in boxes:
        assert min(box.x0, box.y0) >= 0
        assert box.x1 <= figure.bbox.width
        assert box.y1 <= figure.bbox.height
    assert len({axes.get_position().x0 for axes in figure.axes}) == 1
    tall = [axes.get_position().height for axes in figure.axes]
    np.testing.assert_allclose(np.array(tall) / tall[0], np.arange(1, len(tall) + 1))
