"""The finding: what a diagnosis says, with all it rests on."""
