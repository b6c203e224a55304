"""Check of a rig before a plan runs on it: its readings at rest, and one small move of each axis."""
