"""The simulated rig with its buses, but without sockets: states, interlocks, tick, CAN frames and Modbus registers."""
