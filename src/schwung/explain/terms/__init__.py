"""The library of physics terms that an explanation may name, one file per family."""

from schwung.explain.terms.actuator import ACTUATOR
from schwung.explain.terms.coupling import COUPLING
from schwung.explain.terms.friction import FRICTION
from schwung.explain.terms.load import LOAD, LOAD_TABLE, TABLE_FIELDS
from schwung.explain.terms.term import Start, Term, View

#: Name -> term, simpler ones of a family first.
LIBRARY: dict[str, Term] = {term.name: term for term in (*FRICTION, *LOAD, *ACTUATOR, *COUPLING)}


def published(term: str) -> str:
    """The file contract's name of a term: a load torque is one, whatever its shape."""
    return "load_torque" if term == LOAD_TABLE else term


__all__ = ["LIBRARY", "LOAD_TABLE", "TABLE_FIELDS", "Start", "Term", "View", "published"]
