"""At which point of a session an incident comes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from schwung_sim.campaign.draw import Incident

WAIT_S = 0.01  # an incident that comes with a wait does so within so long

#: Frames, seconds and waits of a stage.
Counts = dict[str, float]


class Points:
    """Counts what happens in each stage, and lets incidents befall when they are due.

    `typical`: what a session counts where nothing goes wrong. `stages`: what this one has.
    """

    def __init__(
        self,
        clock: Any,
        incidents: Sequence[Incident],
        typical: Mapping[str, Counts],
        befall: Callable[[Incident], None],
    ) -> None:
        self.stages: dict[str, Counts] = {}
        self._clock, self._pending, self._typical, self._befall = clock, list(incidents), typical, befall
        self._stage, self._counts, self._stage_s = "connect", {"frames": 0.0, "waits": 0.0}, 0.0
        self._calm = False

    def calm(self) -> None:
        """Nothing befalls any more."""
        self._calm = True

    def enter(self, stage: str) -> None:
        """The tool begins with this."""
        now = self._clock.now()
        if stage == self._stage:
            return
        self.stages[self._stage] = {**self._counts, "time": now - self._stage_s}
        self._stage, self._counts, self._stage_s = stage, {"frames": 0.0, "waits": 0.0}, now
        for incident in [
            i for i in self._pending if i.stage == stage and i.by == "time" and i.after_s is None
        ]:
            self._pending.remove(incident)
            self._later(incident, self._point(incident))

    def count(self, what: str) -> None:
        """One more frame, or one more wait."""
        self._counts[what] += 1
        if not self._pending:
            return
        for incident in [i for i in self._pending if self._is_due(i)]:
            self._pending.remove(incident)
            self._later(incident, 0.0 if what == "frames" else WAIT_S * incident.size)

    def _is_due(self, incident: Incident) -> bool:
        if incident.stage != self._stage or incident.by == "time" or incident.after_s is not None:
            return False
        return self._counts[incident.by] > self._point(incident)

    def _point(self, incident: Incident) -> float:
        """At how many frames, seconds or waits of its stage it comes."""
        return incident.share * self._typical.get(incident.stage, {}).get(incident.by, 0.0)

    def _later(self, incident: Incident, delay_s: float) -> None:
        """It befalls so much later; those that follow it come after it."""

        def now() -> None:
            if self._calm:
                return
            self._befall(incident)
            following = [i for i in self._pending if i.after_s is not None]
            if following:
                self._pending.remove(following[0])
                self._later(following[0], following[0].after_s or 0.0)

        self._clock.later(delay_s, now)
