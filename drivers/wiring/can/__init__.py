"""The transport on CAN: messages, how they are protected, and what is heard of them."""
