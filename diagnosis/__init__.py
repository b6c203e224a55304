"""Comparison of measured data with a simulation: its errors, the causes that explain them, and the gain by adding
them.
"""
