"""The bench of two air springs as a system to be diagnosed."""
