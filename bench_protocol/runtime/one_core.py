"""Limit of linear algebra to one core, for programs that use the other cores or run next to other work."""

import os


def keep_algebra_to_one_core() -> None:
    """Limit numpy to one core; must be called before numpy is loaded.

    On a machine with other work, two threads of OpenBLAS wait for each other: a product takes fifty times as long.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
