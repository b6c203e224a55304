"""The command line and composition root: the only place where the rig and its drivers meet."""
