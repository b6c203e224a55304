"""The transport on Modbus: points in registers, how they are read in groups and how they are written."""
