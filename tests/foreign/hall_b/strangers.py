"""What no file can say of rig B: how the checksum of its frames is made."""


def hall_checksum(identifier: int, data: bytes) -> int:
    """Return the byte of Check: start with 0xA5; for each byte, rotate left by one bit, then XOR the byte."""
    check = 0xA5
    for byte in identifier.to_bytes(4, "big") + data[:7]:
        check = (check << 1 & 0xFF | check >> 7) ^ byte
    return check
