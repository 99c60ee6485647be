"""The store: it always opens, says what is wrong where it cannot, and loses nothing that was finished."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from schwung.errors import InputError
from schwung.service.audit import Trail, broken_at
from schwung.service.store import NotFoundError, Store
from schwung.service.store.schema import MIGRATIONS, open_store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "data")


def test_a_migration_keeps_what_is_there_and_is_made_once(tmp_path: Path) -> None:
    path = tmp_path / "old.db"
    old = open_store(path)
    old.execute("INSERT INTO machine VALUES ('0123456789abcdef', 'm', 't', 'w', 's', NULL)")
    old.close()
    newer = [
        *MIGRATIONS,
        "ALTER TABLE machine ADD COLUMN colour TEXT DEFAULT 'grey'; CREATE TABLE more (n INTEGER);",
    ]
    for _ in range(2):
        opened = open_store(path, newer)
        assert opened.execute("SELECT name, colour FROM machine").fetchone()[:] == ("m", "grey")
        assert opened.execute("PRAGMA user_version").fetchone()[0] == len(newer)
        opened.close()


def test_a_migration_that_fails_is_not_half_made(tmp_path: Path) -> None:
    path = tmp_path / "store.db"
    open_store(path).close()
    broken = [*MIGRATIONS, "CREATE TABLE half (n INTEGER); INSERT INTO nowhere VALUES (1);"]
    with pytest.raises(InputError):
        open_store(path, broken)
    again = open_store(path)
    assert again.execute("SELECT count(*) FROM sqlite_master WHERE name = 'half'").fetchone()[0] == 0
    again.close()


def test_a_newer_store_and_a_file_that_is_none_are_refused(tmp_path: Path) -> None:
    newer = tmp_path / "newer.db"
    connection = sqlite3.connect(newer)
    connection.execute(f"PRAGMA user_version = {len(MIGRATIONS) + 1}")
    connection.close()
    with pytest.raises(InputError, match="Use the newer Schwung"):
        open_store(newer)
    other = tmp_path / "other.db"
    other.write_bytes(b"this is no database, whatever its name says " * 100)
    with pytest.raises(InputError, match="no store of Schwung's"):
        open_store(other)


def test_only_ids_of_ours_lead_anywhere(store: Store) -> None:
    for id in ("../../etc/passwd", "", "0" * 16, "0123456789ABCDEF", "0123456789abcdef\n"):
        for look in (store.run, store.run_folder, store.machine_path, store.file, store.session_path):
            with pytest.raises(NotFoundError):
                look(id)


def test_files_are_kept_with_their_sums_and_a_changed_one_is_noticed(store: Store) -> None:
    run = store.add_run("estimate", {"kind": "estimate"}, "w", None, None)
    folder = store.run_folder(run.id)
    (folder / "report.html").write_text("<p>")
    (folder / ".report.html.tmp").write_text("half")
    (folder / "core.dump").write_text("no")
    store.end_run(run.id, "done", {"x": float("nan")})
    assert [file.name for file in store.files(run.id)] == ["report.html"]
    assert store.run(run.id).result == {"x": None}
    file = store.files(run.id)[0]
    assert store.file_path(file.id, check=True).read_text() == "<p>"
    (folder / "report.html").write_text("<script>")
    with pytest.raises(InputError, match="not what it was"):
        store.file_path(file.id, check=True)


def test_two_drives_cannot_be_at_one_place_but_after_the_first_is_archived(store: Store) -> None:
    first = store.add_drive("a", "bus", 3, None, None, "w")
    with pytest.raises(InputError, match="at that place already"):
        store.add_drive("b", "bus", 3, None, None, "w")
    store.change_drive(first.id, archived="2026")
    assert store.add_drive("b", "bus", 3, None, None, "w").name == "b"


def test_a_run_that_goes_on_or_is_still_needed_is_not_removed(store: Store) -> None:
    drive = store.add_drive("a", "bus", 3, None, None, "w")
    run = store.add_run("commission", {}, "w", drive.id, None)
    with pytest.raises(InputError, match="is queued"):
        store.remove_run(run.id)
    store.end_run(run.id, "failed")
    store.add_unsafe(drive.id, run.id, "setup.backup.json")
    store.add_unsafe(drive.id, run.id, "setup.backup.json")
    assert len(store.unsettled()) == 1
    with pytest.raises(InputError, match="not put back"):
        store.remove_run(run.id)
    store.settle(store.unsettled()[0].id, "declined", "w")
    folder = store.run_folder(run.id)
    store.remove_run(run.id)
    assert not folder.exists()


def test_the_trail_is_only_appended_to_and_shows_where_it_was_changed(store: Store) -> None:
    trail = Trail(store)
    for number in range(5):
        trail.add("Ada", "stop", None, None, number=number, word="Größe")
    assert trail.verify() is None
    for statement in ("UPDATE trail SET who = 'Eve'", "DELETE FROM trail"):
        with pytest.raises(sqlite3.IntegrityError, match="only appended"), store.transaction() as db:
            db.execute(statement)
    entries = trail.entries()
    assert broken_at(entries[:2] + entries[3:]) == 3
    with store.transaction() as db:
        db.execute("DROP TRIGGER trail_is_not_changed")
        db.execute("UPDATE trail SET who = 'Eve' WHERE number = 4")
    assert trail.verify() == 4
