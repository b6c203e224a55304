"""The bench for anyone who writes a plan: devices with readings and settings, over CAN and Modbus."""
