"""Any Functional Mock-up Unit (FMI 2.0 or 3.0, co-simulation) as a system that can be diagnosed."""
