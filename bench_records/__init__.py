"""The results of a run: the record of all samples, the results of the checks, and the report."""
