"""The store: what outlives the process. SQLite for what is looked for, files beside it for what is recorded.

    folder/schwung.db            drives, machines, runs, sessions, estimates, explanations, exports, the trail
    folder/runs/<id>/            the files of one run: session.h5, *.backup.json, inertia.csv, report.html, …
    folder/machines/<id>/        machine.toml with its tables

Ids come from `new_id`; names of files are ours. Every method may be called from any thread; each change is one
transaction, on the disk when the method returns. Times are ISO 8601, UTC. Raises NotFoundError for an id that is
not there.
"""

from schwung.service.store.database import NotFoundError, now
from schwung.service.store.drives import Drives
from schwung.service.store.machines import Machines
from schwung.service.store.results import Results
from schwung.service.store.runs import Runs

__all__ = ["NotFoundError", "Store", "now"]


class Store(Machines, Drives, Runs, Results):
    """See the module. Closed by `close`, after which nothing may be called."""
