"""The systems that can be diagnosed: each a simulator with its catalogue of effects, and the way from files to its data."""
