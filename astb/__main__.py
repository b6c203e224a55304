"""`python -m astb` is the command `astb`."""

from astb.cli import main

main()
