"""How often a twin is wrong, how soon it tells what begins, and which causes it names (`python -m benchmarks.twin`)."""

import os

#: Small matrices are not worth the threads of the algebra, which only wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
