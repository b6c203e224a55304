"""The catalogue of effects: every cause that the bench can be given on purpose and that a diagnosis can name."""
