"""How often the intervals of an identification hold, for springs that are drawn and measured through the wires."""
