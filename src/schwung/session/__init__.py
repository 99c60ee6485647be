"""What was recorded: runs, sessions and the file that holds them."""

from schwung.session.hdf5 import SessionWriter, read_session
from schwung.session.model import Axis, PartialRun, Role, Run, Session

__all__ = ["Axis", "PartialRun", "Role", "Run", "Session", "SessionWriter", "read_session"]
