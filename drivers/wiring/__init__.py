"""The wiring: it connects the signals of a bench to the frames and registers of any rig."""
