"""The virtual rig: a pure model of the plant, its parameters, and the shell that puts it on the wires."""
