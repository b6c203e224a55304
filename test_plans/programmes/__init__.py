"""Runs as data: stretches of waves, rest poses and valves, which the bench performs and a model replays."""
