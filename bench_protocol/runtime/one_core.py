"""Linear algebra on one core, for whoever uses the others himself or runs beside something."""

import os


def keep_algebra_to_one_core() -> None:
    """Let numpy multiply on one core; it reads this when it is loaded.

    On a machine that has other work, two threads of OpenBLAS wait for each other: a product takes fifty times as long.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
