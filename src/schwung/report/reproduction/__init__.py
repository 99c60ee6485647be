"""The paper's figures and Table 2 again, from its simulated machine, each beside what the paper reports."""

from schwung.report.reproduction.document import MAKERS, Written, names_of, reproduce
from schwung.report.reproduction.layout import Reproduced

__all__ = ["MAKERS", "Reproduced", "Written", "names_of", "reproduce"]
