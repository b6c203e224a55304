"""Free places in the rubber's lists of extra elements; a list ends at its first element of size zero."""

from typing import Any


def free_slots(amounts: Any, wanted: int, what: str) -> int:
    """Return the index of the first free element; raise ValueError where fewer than ``wanted`` are free."""
    used = int((amounts != 0.0).sum())
    if used + wanted > len(amounts):
        raise ValueError(
            f"{what}: {used} of {len(amounts)} are taken and {wanted} more are asked for; leave out another effect"
        )
    return used
