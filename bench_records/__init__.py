"""The results of a run: the record of every sample, the result of every check, and the report."""
