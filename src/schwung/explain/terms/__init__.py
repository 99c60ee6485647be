"""The library of physics terms that an explanation may name, one file per family."""

from schwung.explain.terms.actuator import ACTUATOR
from schwung.explain.terms.coupling import COUPLING
from schwung.explain.terms.friction import FRICTION
from schwung.explain.terms.load import LOAD
from schwung.explain.terms.term import Start, Term, View

#: Name -> term, simpler ones of a family first.
LIBRARY: dict[str, Term] = {term.name: term for term in (*FRICTION, *LOAD, *ACTUATOR, *COUPLING)}

__all__ = ["LIBRARY", "Start", "Term", "View"]
