"""The method: noise, fits, scores, gates, verdicts. It works for any simulator that keeps `diagnosis.contracts`."""
