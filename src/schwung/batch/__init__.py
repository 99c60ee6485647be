"""Archives: every session of a plant estimated or explained anew, on all cores or on a cluster (Dask).

archive   which sessions there are, which machine belongs to each, and the key of a result
work      what one worker does with one session; nothing that a session holds ends it
results   one file per result, by its key: what is there needs not be done again
cluster   workers of this computer or of a Dask scheduler, and what becomes of one that is lost
run       the whole: what is missing is done, what is done is kept
summary   rows for people, CSV and JSON
picture   curves over angle and over the years
"""

from schwung.batch.archive import Item, Wish, items_of
from schwung.batch.results import Results
from schwung.batch.run import Batch, run_batch
from schwung.batch.summary import Row, write_summary

__all__ = ["Batch", "Item", "Results", "Row", "Wish", "items_of", "run_batch", "write_summary"]
