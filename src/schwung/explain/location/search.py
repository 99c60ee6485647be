"""Which shapes of which coordinates predict the residual: forward, swapped, and pruned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from schwung.explain.location.chance import Null, p_of_position_line, p_of_shapes
from schwung.explain.location.columns import Samples, raised_cosine
from schwung.explain.location.lines import Comb, Line, frequency_line
from schwung.explain.location.space import Space
from schwung.explain.values import Coordinate
from schwung.motion import Array

#: A shape has to carry this share of the energy to be a place worth naming.
LEAST_SHARE = 0.01
#: What a free number of a shape has to earn, as a share of what is still unexplained. First dearly, so that simple
#: shapes come before free curves; then cheaply, so that curves may take what no simple shape explains.
DEAR, CHEAP = 0.03, 0.003
MOST_SHAPES = 10
#: Shapes of this price or less are simple, more are free curves.
SIMPLE = 4.0
#: A coordinate is named below this p-value, corrected for having tried all of them.
SIGNIFICANT = 0.01
COORDINATES: tuple[Coordinate, ...] = (
    "direction", "speed", "acceleration", "torque", "position", "time_in_motion", "run", "frequency",
)  # fmt: skip
#: Noise that a free number takes with it, in σ² (autocorrelated noise: more than one).
NOISE_PRICE = 3.0


@dataclass(eq=False)
class Search:
    """Grows and prunes a set of shapes on one session's samples."""

    samples: Samples
    space: Space
    comb: Comb | None
    chosen: list[int] = field(default_factory=list)
    line_p: dict[int, float] = field(default_factory=dict)  # shape of a frequency line -> p-value
    line_place: dict[int, float] = field(default_factory=dict)

    def run(self) -> None:
        """Choose."""
        for toll in (DEAR, CHEAP):
            while len(self.chosen) < MOST_SHAPES and self._grow(toll):
                pass
        for _ in range(3):
            self._prune()
            swapped = self._swap()
            if not (self._split() or swapped):
                break
        self._prune()

    def remainder(self, chosen: list[int]) -> Array:
        """What the chosen shapes leave of the residual (n,)."""
        return self.samples.residual - self.space.contribution(chosen, chosen)

    def earned(self, gains: Array, left: float, toll: float) -> Array:
        """Gain of each shape less what its free numbers cost, (shapes,). `left`: energy."""
        noise = self.samples.noise**2
        prices = np.array([shape.price for shape in self.space.shapes])
        structure = max(left - noise * self.samples.residual.size, 0.0)
        return np.asarray(gains - prices * (toll * structure + NOISE_PRICE * noise))

    def _scores(self, gains: Array, left: float, toll: float) -> Array:
        """The same; -inf where it is too little to be named."""
        scores = self.earned(gains, left, toll)
        return np.where((gains >= LEAST_SHARE * self.space.energy) & (scores > 0), scores, -np.inf)

    def _grow(self, toll: float) -> bool:
        """Take in the shape that earns most, if it is more than noise makes of its coordinate."""
        left = self.space.energy - self.space.explained(self.chosen)
        self._offer_lines(left, toll)
        gains = self.space.beyond(self.chosen).gains(self.space.products)
        scores = self._scores(gains, left, toll)
        scores[self.chosen] = -np.inf
        null: Null | None = None
        while np.isfinite(np.max(scores)):
            best = int(np.argmax(scores))
            shape = self.space.shapes[best]
            if null is None:
                null = Null.of(self.samples, self.space, self.remainder(self.chosen))
            if self.p_value(shape.coordinate, [best], self.chosen, null) < SIGNIFICANT:
                self.chosen.append(best if shape.bump is None else self._refined(best))
                return True
            scores[[one.coordinate == shape.coordinate for one in self.space.shapes]] = -np.inf
        return False

    def _refined(self, bump: int) -> int:
        """A bump whose place and width are fitted to what is left, to better than the hats' spacing; its index."""
        samples, shape, target = self.samples, self.space.shapes[bump], self.remainder(self.chosen)
        assert shape.bump is not None
        centre, half = shape.bump
        values = samples.values(shape.coordinate)
        factor = samples.sign if shape.signed else np.ones_like(samples.sign)

        def column(at: float, wide: float) -> Array:
            return raised_cosine(values, at, wide, shape.period) * factor

        def gain(at: float, wide: float) -> float:
            made = column(at, wide)
            return float(made @ target) ** 2 / max(float(made @ made), 1e-300)

        best, step = gain(centre, half), 0.35
        while step > 0.02:
            tries = [
                (centre + d * half * step, half * (1 + w * step))
                for d, w in ((1, 0), (-1, 0), (0, 1), (0, -1))
            ]
            gains = [gain(at, wide) for at, wide in tries]
            if max(gains) > best:
                best, (centre, half) = max(gains), tries[int(np.argmax(gains))]
            else:
                step /= 2
        fitted = replace(shape, bump=(centre, half))
        self.space = self.space.with_columns(samples, column(centre, half)[:, None], fitted)
        return len(self.space.shapes) - 1

    def p_value(
        self, coordinate: Coordinate, mine: Sequence[int], others: Sequence[int], null: Null | None = None
    ) -> float:
        """p-value of a coordinate (its shapes `mine`) beyond the other shapes; corrected for eight coordinates.

        `null`: draws of what the others leave, made where not given.
        """
        known = [self.line_p[i] for i in mine if i in self.line_p]
        if known:
            return min(1.0, min(known) * len(COORDINATES))
        if null is None:
            null = Null.of(self.samples, self.space, self.remainder(list(others)))
        p_value = p_of_shapes(self.space, others, coordinate, null)
        if self.comb is not None and any(i in self.line_place for i in mine):
            p_value = 2 * min(p_value, p_of_position_line(self.comb, self.remainder(list(others)), null))
        return min(1.0, p_value * len(COORDINATES))

    def _offer_lines(self, left: float, toll: float) -> None:
        """Put the strongest lines of what is left among the shapes, where they carry anything."""
        remainder = self.remainder(self.chosen)
        offers: list[tuple[Line, float | None]] = []
        if self.comb is not None:
            offers.append((self.comb.strongest(self.samples, remainder), None))
        found = frequency_line(self.samples, remainder)
        if found is not None:
            offers.append(found)
        for line, p_value in offers:
            if line.gain < max(LEAST_SHARE * self.space.energy, toll * line.shape.price * left * 0.5):
                continue
            if any(abs(place / line.place - 1) < 1e-3 and self.space.shapes[i].coordinate == line.shape.coordinate
                   for i, place in self.line_place.items()):  # fmt: skip
                continue
            self.space = self.space.with_columns(self.samples, line.columns, line.shape)
            self.line_place[len(self.space.shapes) - 1] = line.place
            if p_value is not None:
                self.line_p[len(self.space.shapes) - 1] = p_value

    def _swap(self) -> bool:
        """Let every shape be replaced by a better one, given the others: by no curve for little more than it takes."""
        changed = False
        for one in list(self.chosen):
            others = [i for i in self.chosen if i != one]
            left = self.space.energy - self.space.explained(others)
            scores = self._scores(self.space.beyond(others).gains(self.space.products), left, DEAR)
            scores[others] = -np.inf
            best = int(np.argmax(scores))
            if best != one and np.isfinite(scores[best]) and scores[best] > scores[one]:
                self.chosen[self.chosen.index(one)] = best
                changed = True
        return changed

    def _split(self) -> bool:
        """Put a few simple shapes in place of a free curve, where they do as well: dry friction and a tight spot."""
        changed = False
        for rich in [i for i in self.chosen if self.space.shapes[i].price > SIMPLE]:
            kept, before = self.chosen, self.space.explained(self.chosen)
            others = [i for i in kept if i != rich]
            left = self.space.energy - self.space.explained(others)
            self.chosen = list(others)
            while len(self.chosen) < len(others) + 3:
                gains = self.space.beyond(self.chosen).gains(self.space.products)
                scores = self._scores(gains, left, CHEAP)
                scores[[shape.price > SIMPLE for shape in self.space.shapes]] = -np.inf
                scores[self.chosen] = -np.inf
                best = int(np.argmax(scores))
                if not np.isfinite(scores[best]):
                    break
                self.chosen.append(best if self.space.shapes[best].bump is None else self._refined(best))
            new = self.chosen[len(others) :]
            saved = self.space.shapes[rich].price - sum(self.space.shapes[i].price for i in new)
            gained = self.space.explained(self.chosen) - before
            if new and gained + saved * CHEAP * left > 0:
                changed = True
            else:
                self.chosen = kept
        return changed

    def _prune(self) -> None:
        """Drop what the others make superfluous, the least first."""
        while self.chosen:
            whole = self.space.explained(self.chosen)
            worth = []
            for one in self.chosen:
                others = [i for i in self.chosen if i != one]
                without = self.space.explained(others)
                gains = np.zeros(len(self.space.shapes))
                gains[one] = whole - without
                worth.append(self._scores(gains, self.space.energy - without, CHEAP)[one])
            least = int(np.argmin(worth))
            if np.isfinite(worth[least]):
                return
            del self.chosen[least]
