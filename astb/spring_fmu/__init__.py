"""Springs that an FMU computes, behind the wires of a simulated rig."""
