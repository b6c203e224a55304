"""Campaigns: many cases of one question, on all cores or on a cluster, each kept as soon as it is finished."""
