"""Step 1, the residual: what is wrong with a fitted model, and where, without a name for the cause."""
