"""What the bench says to each claim of the paper: measured, beside the closed form, and whether it holds."""
