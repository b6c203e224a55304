"""Programmes: runs as data (waves, rest poses, valve positions). The bench performs them, and a model replays them."""
