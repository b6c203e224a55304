"""The transport on Modbus: points in registers, read in groups and written in as few requests as possible."""
