"""What a run leaves behind: the record of every sample, the result of every check, and the report of both."""
