"""A run in progress as data: snapshots for a terminal and for other clients."""
