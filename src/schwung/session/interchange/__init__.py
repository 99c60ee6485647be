"""Sessions in other people's formats, and back without loss: MDF4, Parquet.

described.py  everything of a session but its samples, as JSON
mdf.py        ASAM MDF 4: a channel group per run
parquet.py    one table, with a column that counts runs
convert.py    which of them, by name
"""

from schwung.session.interchange.convert import FORMATS, read_any, write_any

__all__ = ["FORMATS", "read_any", "write_any"]
