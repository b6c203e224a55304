"""Identification: the parameters of the spring from what the bench recorded, with confidence intervals.

Everything comes from the curves of a ``result.json``; what is not fitted is read from the base parameter file that the
result will replace.
"""
