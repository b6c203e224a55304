"""Springs of the simulated rig that are computed by an FMU."""
