"""One Modbus request and its answer from the rig's registers, beside a raw socket with the same bytes."""

import contextlib
import socket

from benchmarks.measure import Effort, Section, compare, interleaved, trips
from benchmarks.peers import ADDRESS, MODBUS_REPLY, MODBUS_REQUEST, REGISTERS, connected, peers
from drivers.modbus_port import open_modbus

TRIPS, QUICK_TRIPS = 500, 200


def run(effort: Effort) -> Section:
    """Measure the drivers' client, the bare server and the bare socket in turn."""
    count = QUICK_TRIPS if effort.quick else TRIPS
    with contextlib.ExitStack() as stack:
        ports = stack.enter_context(peers())
        client = open_modbus("127.0.0.1", ports.modbus)
        stack.callback(client.close)
        bare = stack.enter_context(connected(ports.modbus))
        raw = stack.enter_context(connected(ports.raw_modbus))

        def exchange(sock: socket.socket) -> None:
            sock.sendall(MODBUS_REQUEST)
            if len(sock.recv(4096)) != len(MODBUS_REPLY):
                raise RuntimeError("an answer did not come back whole")

        found = interleaved(
            effort.repetitions,
            {
                "raw": lambda: trips(lambda: exchange(raw), count),
                "server": lambda: trips(lambda: exchange(bare), count),
                "client": lambda: trips(lambda: client.read_input(ADDRESS, REGISTERS), count),
            },
        )
    against = "raw TCP, the same bytes"
    rows = (
        compare("request and answer, drivers (pymodbus)", found["client"], against, found["raw"]),
        compare("request and answer, bare client", found["server"], against, found["raw"]),
    )
    notes = (
        f"Reading {REGISTERS} input registers (FC 4) of a rig in another process, medians. The bare client sends the "
        "request as bytes and decodes nothing: what is over the raw socket's time is our server's and the rig's.",
    )
    return Section("Modbus/TCP", rows, notes)
