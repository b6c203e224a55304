"""The commands of the acceptance, which `astb` finds by their entry points."""
