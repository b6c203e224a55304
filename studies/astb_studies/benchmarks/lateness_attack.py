"""An attack on both ports of a rig: malformed lines and unknown frames on CAN, hostile requests on Modbus.

python -m astb_studies.benchmarks.lateness_attack CAN_PORT MODBUS_PORT    goes on until the rig or its parent has ended
"""

import contextlib
import random
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from bench_protocol.can_codec import Encoder
from bench_protocol.socketcand import send_bytes
from bench_protocol.table import TABLE
from bench_protocol.units import ms

#: Lines and requests in one burst, and the period: about 20 000 lines and 4000 requests per second.
LINES: Final = 100
REQUESTS: Final = 20
PERIOD: Final = 5 * ms
#: The hub disconnects a client that sends only invalid lines, so the client connects again.
_PATIENCE: Final = 1.0


def lines(chance: random.Random) -> bytes:
    """Return commands of a client without the lease, unknown frames and invalid lines."""
    values = np.zeros(len(TABLE.signals))
    encoder = Encoder(TABLE)
    strange = encoder.encode(values, encoder.rows(["Control", "ForceSetpoints", "DisplacementSetpoints"]), 0)
    parts = [send_bytes(strange) for _ in range(LINES // 4)]
    parts += [b"< send %x 8 %s >" % (chance.randrange(0x500, 0x600), b"ff " * 8) for _ in range(LINES // 4)]
    parts.append(b"< send 7ff 99 zz >")
    return b"".join(parts)


def requests(chance: random.Random) -> bytes:
    """Return writes without authority, reads outside the map and unknown functions, all well framed."""
    pdus = [
        *(
            struct.pack(">BHH", 6, chance.randrange(300), chance.randrange(0x10000))
            for _ in range(REQUESTS // 2)
        ),
        *(struct.pack(">BHH", 3, chance.randrange(0x10000), 125) for _ in range(REQUESTS // 4)),
        *(bytes((chance.randrange(65, 128),)) + chance.randbytes(20) for _ in range(REQUESTS // 4)),
    ]
    return b"".join(struct.pack(">HHHB", k, 0, len(pdu) + 1, 1) + pdu for k, pdu in enumerate(pdus))


def attack(
    port: int, greeting: bytes, load: Callable[[random.Random], bytes], until: threading.Event
) -> None:
    """Send ``load`` again and again, on a new connection whenever one is closed."""
    chance = random.Random(port)
    data = load(chance)
    while not until.is_set():
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), _PATIENCE) as sock:
            sock.sendall(greeting)
            due = time.perf_counter()
            while not until.is_set():
                sock.sendall(data)
                with contextlib.suppress(BlockingIOError):
                    if sock.recv(1 << 16, socket.MSG_DONTWAIT) == b"":
                        break
                due += PERIOD
                time.sleep(max(0.0, due - time.perf_counter()))
        time.sleep(PERIOD)


def main(can_port: int, modbus_port: int) -> None:
    """Attack both ports until the input ends."""
    end = threading.Event()
    for arguments in ((can_port, b"< open vcan0 >< rawmode >", lines), (modbus_port, b"", requests)):
        threading.Thread(target=attack, args=(*arguments, end), daemon=True).start()
    sys.stdin.read()
    end.set()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
