"""A STOP while nothing moves: once released, the next commissioning goes as if there had been none."""

from __future__ import annotations

from pathlib import Path

from service_desk import nothing_estimated, service_desk


def test_after_a_stop_at_rest_and_its_release_a_drive_moves_again(tmp_path: Path) -> None:
    with nothing_estimated(), service_desk(tmp_path) as desk:
        desk.proposed()  # the drive is connected
        for _ in range(2):
            desk.service.stop("tester")  # the page posts to both listeners
        desk.proposed()
        desk.service.release("tester")
        run = desk.ended(desk.confirmed().id)
        assert run.state == "done", run.error
