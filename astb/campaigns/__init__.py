"""Campaigns: many cases, such as runs of plans with different parameters, on all cores or on a cluster.

Each result is stored when its case ends.
"""
