"""Studies made with the bench: the paper on crosswind, benchmarks, counted mutations and the gallery."""
