"""The systems that can be diagnosed: each has a simulator, a catalogue of effects, and a reader of files."""
