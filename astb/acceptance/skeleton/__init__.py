"""A first wiring file of a rig, from its DBC and its list of registers."""
