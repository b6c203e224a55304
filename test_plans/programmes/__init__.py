"""Runs that are data: stretches of waves, stands and valves, which the bench performs and a model replays."""
