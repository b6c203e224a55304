"""Seeded faults that the test plans detect, and sound rigs that pass: ``python -m astb_studies.mutations.measure``."""
