"""The rehearsal of a plan: a run in virtual time before a rig moves, with extremes and margins to limits."""
