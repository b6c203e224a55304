"""Sweeps of one quantity over another, which several plans of the paper's figures use."""
