"""The bench with two air springs as a system that can be diagnosed."""
