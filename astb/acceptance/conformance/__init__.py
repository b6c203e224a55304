"""A black-box suite over a rig's wires: what it says, what it answers, what it refuses, and what it does when told."""
