"""The simulated rig behind its wires: states, interlocks, tick, CAN frames and Modbus registers, without a socket."""
