"""Functional Mock-up Units (FMI 2.0 and 3.0, co-simulation): reads them, and runs them in separate processes."""
