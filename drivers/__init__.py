"""Interface to the bench for test plans: devices with readings and settings, over CAN and Modbus."""
