"""The commands of `astb`, a file for each group of them."""
