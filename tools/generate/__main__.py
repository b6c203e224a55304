"""Writes the files that are generated from the tables of signals, states, parameters and effects, or checks them.

python -m tools.generate           write
python -m tools.generate --check   exit 1 if a checked-in file differs from what would be written
"""

import sys

from tools.generate.files import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
