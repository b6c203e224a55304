"""The virtual rig: a pure model of the plant, its parameters, and its CAN and Modbus interfaces."""
