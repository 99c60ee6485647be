"""The page that an engineer works from: NiceGUI on the service's application.

It has no procedure of its own: every button asks the service for a run, as a client of the API does.

    desk.py        who looks, the frame of every page, buttons, panels
    style.py       colours (the report's) and static files; static/ has theme, order, STOP, diagrams and scope
    markup.py      tables, tags, checks as HTML; words.py: states and verdicts in words
    diagrams.py    what is drawn; decimation.py, scope.py: samples to the browser as they come
    drives.py      the list of drives, and one drive; wizard/: commissioning step by step
    runs.py        what was done, by outcome.py, explaining.py, motions.py, reported.py, proposals.py, following.py
    comparing.py   runs against each other; machines.py, trail.py
"""

from schwung.service.pages.mount import mount_pages

__all__ = ["mount_pages"]
