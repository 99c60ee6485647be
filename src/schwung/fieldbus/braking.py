"""Whether an axis that was told to stop still slows down. How long that takes is the drive's business (its ramp, 6085,
and what it has to brake), not a constant of ours: the voltage stays as long as it does."""

from __future__ import annotations

import math

from schwung.errors import CoastingError

#: An axis whose speed has not fallen for so long (s) does not brake.
PATIENCE_S = 2.0
_WINDOW_S = 0.2  # over which a speed is taken
_FALLS = 0.99  # a speed that is higher than this share of the lowest so far has not fallen
_SLOWEST_S = 10.0  # no brake that nobody sees is waited for any longer


class Slowing:
    """Looks at positions as they are read, in any unit, and at times (s) by any clock."""

    def __init__(self) -> None:
        self.speed = math.nan  # within the last window, in units of the position per second
        self._lowest = math.inf
        self._since_s = math.nan  # when it was lowest
        self._begin: tuple[float, float] | None = None

    def look(self, time_s: float, position: float) -> bool:
        """False where the speed has not fallen for PATIENCE_S. A position that is not known (NaN) is skipped."""
        if math.isnan(self._since_s):
            self._since_s = time_s
        if self._begin is None or math.isnan(self._begin[1]):
            self._begin = time_s, position
        elif not math.isnan(position) and time_s - self._begin[0] >= _WINDOW_S:
            self.speed = abs(position - self._begin[1]) / (time_s - self._begin[0])
            if self.speed < _FALLS * self._lowest:
                self._lowest, self._since_s = self.speed, time_s
            self._begin = time_s, position
        return time_s - self._since_s < PATIENCE_S

    def given_up(self, place: str, count_rad: float | None) -> CoastingError:
        """What to tell where its voltage had to go while it turned; `count_rad`: worth of a unit of the position."""
        known = count_rad is not None and math.isfinite(count_rad * self.speed)
        at = f" at {abs(self.speed * (count_rad or 0.0)):.3g} rad/s" if known else ""
        return CoastingError(
            place,
            f"was told to stop and still turned{at}, no slower for {PATIENCE_S:g} s: its voltage was switched off, it "
            "coasts",
            "Stay clear of the machine until it stands; then look at 605A, 6085 and the brake.",
        )


def unseen_s(speed_rad_s: float, deceleration_rad_s2: float | None) -> float:
    """How long (s) to wait for an axis that nobody sees, from when it was told to stop: by what it was set to."""
    if deceleration_rad_s2 is None or not deceleration_rad_s2 > 0:
        return PATIENCE_S
    return min(max(PATIENCE_S, 0.5 + 1.2 * speed_rad_s / deceleration_rad_s2), _SLOWEST_S)
