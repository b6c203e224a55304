"""A study of the paper: its figures and claims made again, on the virtual bench and in closed form."""
