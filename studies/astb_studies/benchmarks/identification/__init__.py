"""Coverage of the confidence intervals of an identification, for drawn springs measured through CAN and Modbus."""
