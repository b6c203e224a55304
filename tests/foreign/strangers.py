"""What no file can say of rig B: how its checksum is made."""


def hall_checksum(identifier: int, data: bytes) -> int:
    """Return the xor of 0xA5, the four bytes of the identifier and the first seven of the data."""
    found = 0xA5
    for byte in identifier.to_bytes(4, "big") + data[:7]:
        found ^= byte
    return found
