"""The transport on OPC UA."""
