"""How often a diagnosis is right, measured on systems with something hidden in them."""

import os

# As `astb` does, and like it before numpy is loaded: threads of the algebra library would be in our own threads' way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
