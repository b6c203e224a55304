"""The twin: the model runs beside a run, and says while it goes on that they part, where, and since when."""
