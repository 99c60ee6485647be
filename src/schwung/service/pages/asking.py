"""Ask the service for a run, and show here how it goes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui
from nicegui.element import Element

from schwung.service.pages.desk import Desk
from schwung.service.pages.watching import Watched
from schwung.service.values import RunView


class Asked:
    """A place of the page where one run at a time is shown."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._place: Element | None = None

    def place(self) -> None:
        """Here."""
        self._place = ui.element("div").classes("sw-column")

    def ask(self, request: Mapping[str, Any], then: Callable[[RunView], Any] | None = None) -> RunView:
        """Ask; raises what Service.submit raises. `then` is called when it has ended, however it did."""
        run = self._desk.service.submit(request, self._desk.who)
        self.watch(run, then)
        return run

    def watch(self, run: RunView, then: Callable[[RunView], Any] | None = None) -> None:
        """Show a run that was asked for already."""
        place = self._place
        assert place is not None
        place.clear()

        def ended(done: RunView) -> None:
            if done.state == "done":
                place.clear()
            if then is not None:
                then(done)

        with place:
            Watched(self._desk, run, ended)
