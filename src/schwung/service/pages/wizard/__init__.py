"""Commissioning step by step: connect, check, plan, confirm, run, result, export.

guide.py     the steps, what is known so far, and the way between them
before.py    what comes before the machine moves: connect, check, confirm
planning.py  the wishes, and the plan with its prediction
after.py     run, result
exporting.py what is written into the drive: proposed, confirmed, read back
page.py      the page: the steps put together
"""

from schwung.service.pages.wizard.page import commissioning

__all__ = ["commissioning"]
