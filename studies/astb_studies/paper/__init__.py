"""A study of the paper: its figures and claims made anew, on the virtual bench and in closed form."""
