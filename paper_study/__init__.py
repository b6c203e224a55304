"""The paper beside the bench: its claims and the checks of both model layers, each evaluated instead of quoted."""
