"""A black-box test suite for the wires of a rig: its messages, answers, refusals, and reactions to commands."""
