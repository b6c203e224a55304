"""Campaigns: many cases of one question, on all cores or on a cluster; each result is stored when its case ends."""
