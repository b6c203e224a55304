"""The model as Functional Mock-up Units, for simulations of others."""
