"""What no file can say of rig B: how the checksum of its frames is made."""


def hall_checksum(identifier: int, data: bytes) -> int:
    """Return the byte of Check: from 0xA5 on, rotated left by one bit and xored with each byte before it."""
    check = 0xA5
    for byte in identifier.to_bytes(4, "big") + data[:7]:
        check = (check << 1 & 0xFF | check >> 7) ^ byte
    return check
