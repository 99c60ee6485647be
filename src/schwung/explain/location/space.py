"""Least squares where every question is one of inner products: gains, remainders, shares and permutations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from schwung.explain.location.columns import Dictionary, Samples, Shape
from schwung.motion import Array

#: A direction of which less than this is left after the chosen shapes is not told apart from them.
SEPARATE = 1e-3
#: A single shape needs this much of itself outside the others.
OWN = 3e-3


@dataclass(frozen=True, eq=False)
class Space:
    """Columns (n, K), their Gram matrix (K, K), products with the residual (K,), and the shapes on them."""

    columns: Array
    gram: Array
    products: Array
    energy: float
    shapes: tuple[Shape, ...]

    @classmethod
    def of(cls, samples: Samples, words: Dictionary) -> Space:
        """Take all inner products once."""
        columns, residual = words.columns, samples.residual
        return cls(
            columns,
            (columns.T @ columns).astype(np.float64),
            (columns.T @ residual.astype(np.float32)).astype(np.float64),
            float(residual @ residual),
            words.shapes,
        )

    def with_columns(self, samples: Samples, block: Array, shape: Shape) -> Space:
        """The same with further columns (n, k), which the shape consists of."""
        block = block.astype(np.float32)
        cross = (self.columns.T @ block).astype(np.float64)
        own = (block.T @ block).astype(np.float64)
        old, new = self.gram.shape[0], block.shape[1]

        shape = replace(shape, weights=np.concatenate([np.zeros((old, new)), np.eye(new)]))
        return Space(
            np.concatenate([self.columns, block], axis=1),
            np.block([[self.gram, cross], [cross.T, own]]),
            np.r_[self.products, block.T @ samples.residual],
            self.energy,
            (*self.shapes, shape),
        )

    @cached_property
    def singles(self) -> tuple[NDArray[np.int64], Any, Array]:
        """Which shapes have one column (m,), their weights (m, K) as a sparse matrix, and their own energy (m,)."""
        which = np.array(
            [i for i, one in enumerate(self.shapes) if one.weights.shape[1] == 1], dtype=np.int64
        )
        own = [self.shapes[i].own for i in which]
        values = np.concatenate([self.shapes[i].weights[at, 0] for i, at in zip(which, own, strict=True)])
        ends = np.r_[0, np.cumsum([at.size for at in own])]
        weights = csr_array((values, np.concatenate(own), ends), shape=(which.size, self.gram.shape[0]))
        energy: Array = np.asarray(weights.multiply(weights @ self.gram).sum(axis=1)).ravel()
        return which, weights, energy

    def weights(self, chosen: Sequence[int]) -> Array:
        """Weights (K, k) of the chosen shapes beside each other."""
        parts = [self.shapes[i].weights for i in chosen]
        beside = np.zeros((self.gram.shape[0], sum(part.shape[1] for part in parts)))
        at = 0
        for part in parts:
            beside[: part.shape[0], at : at + part.shape[1]] = part
            at += part.shape[1]
        return beside

    def coefficients(self, chosen: Sequence[int]) -> Array:
        """Least-squares coefficients (k,) of the chosen shapes' columns."""
        weights = self.weights(chosen)
        return _inverse(weights.T @ self.gram @ weights) @ (weights.T @ self.products)

    def explained(self, chosen: Sequence[int]) -> float:
        """Energy that the chosen shapes predict together."""
        weights = self.weights(chosen)
        return float(self.coefficients(chosen) @ (weights.T @ self.products))

    def contribution(self, chosen: Sequence[int], part: Sequence[int]) -> Array:
        """What `part` of the chosen shapes contributes to the joint fit (n,)."""
        if not part:
            return np.zeros(self.columns.shape[0])
        ordered = [*part, *(i for i in chosen if i not in part)]
        mine = self.weights(part)
        coefficients = self.coefficients(ordered)[: mine.shape[1]]
        return (self.columns @ (mine @ coefficients).astype(np.float32)).astype(np.float64)

    def beyond(self, chosen: Sequence[int]) -> Beyond:
        """What is left of everything once the chosen shapes are taken out."""
        weights = self.weights(chosen)
        seen = self.gram @ weights
        taken = seen @ _inverse(weights.T @ seen) if chosen else np.zeros_like(seen)
        return Beyond(self, self.gram - taken @ seen.T, taken, weights)


@dataclass(frozen=True, eq=False)
class Beyond:
    """Gains of shapes beyond some chosen ones."""

    space: Space
    gram: Array
    taken: Array
    weights: Array

    def products(self, products: Array) -> Array:
        """Products (K,) or (K, draws) with a residual, after the chosen shapes are taken out of it."""
        cleared: Array = products - self.taken @ (self.weights.T @ products)
        return cleared

    def gains(self, products: Array, which: NDArray[np.bool_] | None = None) -> Array:
        """Energy that each shape predicts beyond the chosen ones: (shapes[, draws]); 0 for those not asked."""
        space = self.space
        left = self.products(products)
        asked = np.ones(len(space.shapes), dtype=bool) if which is None else which
        gains = np.zeros((len(space.shapes), *products.shape[1:]))
        index, weights, whole = space.singles
        keep = np.flatnonzero(asked[index])
        index, weights, whole = index[keep], weights[keep], whole[keep]
        own = np.asarray(weights.multiply(weights @ self.gram).sum(axis=1)).ravel()
        usable = own > OWN * np.maximum(whole, 1e-300)
        top = (weights @ left) ** 2
        factor = np.where(usable, 1 / np.where(usable, own, 1.0), 0.0)
        gains[index] = top * (factor if top.ndim == 1 else factor[:, None])
        for i, shape in enumerate(space.shapes):
            if asked[i] and shape.weights.shape[1] > 1:
                mine, block = shape.weights[shape.own], np.ix_(shape.own, shape.own)
                inner = mine.T @ self.gram[block] @ mine
                scale = float(np.max(np.diag(mine.T @ space.gram[block] @ mine)))
                seen = mine.T @ left[shape.own]
                gains[i] = np.sum(seen * (_inverse(inner, SEPARATE * scale) @ seen), axis=0)
        return gains


def _inverse(matrix: Array, floor: float | None = None) -> Array:
    """Pseudo-inverse of a symmetric matrix, without directions weaker than the floor."""
    if matrix.shape[0] == 0:
        return matrix
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    floor = 1e-5 * float(np.max(values)) if floor is None else floor
    keep = values > max(floor, 1e-300)
    inverse: Array = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    return inverse
