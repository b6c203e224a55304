"""A computed car on measured springs: real-time hybrid simulation, with the stability of its loop."""
