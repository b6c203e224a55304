"""A study that reproduces figures and claims of the paper, on the virtual bench and in closed form."""
