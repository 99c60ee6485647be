"""The whole archive: what is missing is done, what is done is kept, and nothing that one session does ends it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from schwung import __version__
from schwung.batch.archive import Item, Wish, key_of
from schwung.batch.cluster import Tell, begin_start, cores, outcomes, workers
from schwung.batch.results import Results
from schwung.batch.summary import Row, rows_of
from schwung.batch.work import Outcome, failed
from schwung.errors import SchwungError

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Batch:
    """What is known of an archive: one row per session that is done, oldest first, failures included."""

    rows: tuple[Row, ...]
    found: int  # of the rows, so many were there already
    missing: int  # sessions not done, because it was interrupted

    @property
    def failures(self) -> tuple[Row, ...]:
        """The sessions that gave no result."""
        return tuple(row for row in self.rows if row.error)


def run_batch(
    items: Sequence[Item],
    wish: Wish,
    results: Results,
    *,
    scheduler: str | None = None,
    jobs: int | None = None,
    again: bool = False,
    progress: Progress = lambda _text, _share: None,
    tell: Tell = lambda _sentence: None,
) -> Batch:
    """Estimate or explain all of them that have no result yet (`again`: all), and keep each as soon as it is there.

    `scheduler`, `jobs`: see `workers`; None: one process per core. An interrupt (Ctrl-C) ends it well: what is done is
    kept, `missing` says what is not. Raises InputError for a scheduler that is none, and where a result cannot be kept.
    """
    done: dict[Item, Outcome] = {}
    keys: dict[Item, str] = {}
    found, interrupted = 0, False
    try:
        for number, item in enumerate(items):
            progress("Looking through the archive", number / len(items))
            try:
                keys[item] = key_of(item, wish)
            except SchwungError as error:
                done[item] = failed(str(error))
                continue
            if not again and (kept := results.find(keys[item])) is not None:
                done[item] = kept
            elif scheduler is None:
                begin_start()
        found = sum(outcome.error is None for outcome in done.values())
        _tell_of_versions(done.values(), tell)
        work = [(item, keys[item]) for item in items if item not in done]
        if work:
            wanted = min(jobs or cores(), len(work))
            progress("Starting workers", 0.0)
            with workers(scheduler, wanted, tell) as client:
                progress(f"Sessions, 0 of {len(work)}", 0.0)
                for number, (item, key, outcome) in enumerate(outcomes(client, work, wish), start=1):
                    if outcome.error is None:
                        results.keep(key, outcome)
                    done[item] = outcome
                    progress(f"Sessions, {number} of {len(work)}", number / len(work))
    except KeyboardInterrupt:
        interrupted = True
        for item, key in keys.items():  # it may have come between keeping one and noting it
            if item not in done and (kept := results.find(key)) is not None:
                done[item] = kept
    return Batch(rows_of(done), found, len(items) - len(done) if interrupted else 0)


def _tell_of_versions(kept: Iterable[Outcome], tell: Tell) -> None:
    """Results are kept whoever made them; that another Schwung did is worth a word."""
    others = [outcome.code_version for outcome in kept if outcome.error is None]
    others = [version for version in others if version != __version__]
    if others:
        names = " and ".join(sorted(set(others)))
        tell(f"{len(others)} results are of Schwung {names}, this is {__version__}: --again makes them anew")
