"""The twin: the model runs together with a run, and says while it goes on that they deviate, where, and since when."""
