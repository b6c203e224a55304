"""How the command `astb` ends: what its exit codes mean."""

from typing import Final

PASS: Final = 0
FAIL: Final = 1  #: a plan judged the product, and it broke a limit
MISUSE: Final = 2  #: the user asked for something that cannot be
BLOCKED: Final = 3  #: the rig or a precondition broke, not the product
