"""Causes weighed by their evidence under one likelihood: `weigh` (weigh.py) is the door.

Read on from there. A session's causes are whitened once a round (`round`, `data`), in which everything smooth that
may be there says what is noise (`wide`, `its_noise`). Sets of causes (`sets`) are searched (`search`, `offers`,
`refine`), each is brought to rest (`settling`, `resting`), grown from few runs to all (`grown`, `growth`, `asked`,
`exchange`), and judged: by repeats (`repeated`), by motions left out (`elsewhere`, `one_law`), and by what has no name
(`standing`). `work` counts what it costs; `experiment` says what a further motion would tell.
"""
