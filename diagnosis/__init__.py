"""What measured data say of a simulation: where it is wrong, which cause explains it, and what adding it gains."""
