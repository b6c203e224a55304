"""``astb watch``: compares a run with its model, which runs next to it."""
