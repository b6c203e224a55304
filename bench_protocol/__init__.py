"""The shared definitions of the wires: names, units, encodings and time, independent of rig and drivers."""
