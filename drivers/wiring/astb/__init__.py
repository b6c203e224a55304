"""Transports to a rig that uses our own table: CAN, Modbus, the watchdog, and reasons for refusals."""
