"""Functional Mock-up Units (FMI 2.0 and 3.0, co-simulation): how they are read and run in separate processes."""
