"""For all tests: one thread for linear algebra, as the command line has it; two workers are enough for two cores."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
