"""The transport on CAN: messages, their protection, and their reception."""
