"""The plant: the air spring test bench as compiled differential equations, without time, chance or input and output."""
