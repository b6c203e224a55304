"""The rehearsal of a plan: in virtual time, before a rig moves, how far it would go and how close to which limits."""
