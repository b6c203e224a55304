"""Programmes: runs as data. Stretches of waves, rest poses and valves, which the bench performs and a model replays."""
