"""The wiring: what stands between the signals of a bench and whatever frames and registers a rig has."""
