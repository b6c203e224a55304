"""A run while it lasts, as data: snapshots that a terminal draws now, and anyone who asks."""
