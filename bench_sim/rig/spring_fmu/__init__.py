"""Springs of the simulated rig that an FMU computes."""
