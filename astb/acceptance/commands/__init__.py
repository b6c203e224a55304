"""Commands of the acceptance checks; `astb` finds them by their entry points."""
