"""What a stranger's columns seem to be, by what position, speed and torque must satisfy.

prepared.py  the time, and all columns on one clock
signals.py   which column is the slope of which, which gathers speed, which leads
units.py     units by the ratio of a speed to the slope of its position
propose.py   the import that follows, each part with its evidence
"""

from schwung.session.guess.propose import Curves, Guess, Proposal, propose

__all__ = ["Curves", "Guess", "Proposal", "propose"]
