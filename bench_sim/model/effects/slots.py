"""Where an effect of the rubber finds room: the lists of extra elements end at the first element of nothing."""

from typing import Any


def free_slots(amounts: Any, wanted: int, what: str) -> int:
    """Return the place of the first free element of a list; raise ValueError where fewer than ``wanted`` are free."""
    used = int((amounts != 0.0).sum())
    if used + wanted > len(amounts):
        raise ValueError(
            f"{what}: {used} of {len(amounts)} are taken and {wanted} more are asked for; leave out another effect"
        )
    return used
