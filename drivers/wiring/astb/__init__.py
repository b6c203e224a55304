"""Transports to a rig that speaks our own table: CAN, Modbus, the watchdog, and why it refuses."""
