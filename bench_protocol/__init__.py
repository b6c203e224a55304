"""What crosses the wires: names, units, encodings and time, and nothing of either end."""
