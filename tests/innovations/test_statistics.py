"""Sums of products of columns."""

from __future__ import annotations

import numpy as np
import pytest

from schwung.innovations.statistics import products, products_with


@pytest.mark.parametrize(
    ("count", "others", "samples"),
    [(1, 1, 3), (1, 3, 300_000), (4, 64, 4096), (7, 130, 50_000), (100, 65, 9000)],
)
def test_they_have_all_figures_that_the_columns_have(count: int, others: int, samples: int) -> None:
    """Also where the columns are nearly one: a sum in single precision would tell them apart by its rounding."""
    random = np.random.default_rng(7)
    shared = random.normal(size=samples)
    one, other = (
        (shared + 1e-4 * random.normal(size=(size, samples))).astype(np.float32) for size in (count, others)
    )
    np.testing.assert_allclose(products(one, other), one.astype(float) @ other.astype(float).T, rtol=1e-12)
    np.testing.assert_allclose(
        products(shared[None], other), shared[None] @ other.astype(float).T, rtol=1e-12
    )


def test_what_runs_away_spoils_its_own_alone() -> None:
    """Columns far off are infinite somewhere: the others are compared all the same."""
    columns = np.random.default_rng(8).normal(size=(70, 5000)).astype(np.float32)
    broken = columns.copy()
    broken[3, 17], broken[66, 4000] = np.inf, np.nan
    sound = [i for i in range(70) if i not in (3, 66)]
    found = products(broken, broken)
    np.testing.assert_allclose(
        found[np.ix_(sound, sound)], products(columns, columns)[np.ix_(sound, sound)], rtol=1e-12
    )
    assert not np.any(np.isfinite(found[[3, 66]]))


def test_nothing_has_products_with_nothing() -> None:
    """Of no columns."""
    none, some = np.empty((0, 100), dtype=np.float32), np.ones((2, 100), dtype=np.float32)
    assert products(none, some).shape == (0, 2)
    assert products(some, none).shape == (2, 0)


@pytest.mark.parametrize(("count", "samples"), [(1, 300_000), (90, 7000)])
def test_those_with_a_target_are_the_same(count: int, samples: int) -> None:
    """As of columns with one another and with a column that is the target."""
    random = np.random.default_rng(9)
    columns, target = random.normal(size=(count, samples)).astype(np.float32), random.normal(size=samples)
    gram, slope = products_with(target, columns)
    np.testing.assert_allclose(gram, products(columns, columns), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(slope, products(target[None], columns)[0], rtol=1e-12, atol=1e-9)
