"""Ask the service for a run, and show here how it goes and what came of it."""

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
        self._show: Callable[[RunView], Any] | None = None
        self.run: RunView | None = None

    def place(self, show: Callable[[RunView], Any] | None = None) -> None:
        """Here; `show` adds what came of a run that is done."""
        self._place = ui.element("div").classes("sw-column")
        self._show = show

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
        self.run = run

        def ended(done: RunView) -> None:
            self.run = done
            if done.state == "done":
                place.clear()
                if self._show is not None:
                    with place:
                        self._show(done)
            if then is not None:
                then(done)

        with place:
            Watched(self._desk, run, ended)
