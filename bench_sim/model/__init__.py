"""The plant: the air spring test bench as compiled differential equations, without real time, random numbers, input or
output.
"""
