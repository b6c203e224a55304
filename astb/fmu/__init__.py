"""Export of the model as Functional Mock-up Units for other simulation programs."""
