"""Step 1, the residual: the errors of a fitted model and where they occur, without a name for the cause."""
