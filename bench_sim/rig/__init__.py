"""The simulated rig with states, interlocks, tick, CAN frames and Modbus registers. Network connections
are separate.
"""
