"""Runs over time: one process owns the buses, keeps every run, and is spoken to over HTTP.

Why, and which thread does what: docs/decisions/0014-one-service-owns-the-bus.md.

    values.py      what the parts exchange: Settings, BusEntry, RunState, RunView
    store.py       SQLite and the files beside it: drives, machines, runs, sessions, estimates, explanations, exports
    requests.py    what can be asked for, one pydantic model per kind of run
    jobs.py        the queue: lanes, progress, cancel
    lanes.py       one thread per bus, in which the drivers live; STOP's own thread
    workshop.py    processes that compute
    work/          what each kind of run does, with the rooms below
    live.py        samples as they come
    audit.py       who did what, in a chain of hashes
    guard.py       who may
    service.py     all of it together: what page and API use
    api/           HTTP; app.py makes the application; serve.py runs it
"""
