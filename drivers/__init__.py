"""The bench for whoever writes a plan: devices with readings and settings, over CAN and Modbus."""
