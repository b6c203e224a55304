"""The systems that can be diagnosed: each a simulator with its catalogue of effects, and its way from files to data."""
