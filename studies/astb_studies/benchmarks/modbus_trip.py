"""Round trip of a Modbus request to the rig's registers, compared with a raw socket with the same bytes."""

import contextlib
import socket
import tempfile
from pathlib import Path
from statistics import median
from typing import Final

from astb_studies.benchmarks import gcc
from astb_studies.benchmarks.measure import Effort, Section, Skipped, child, compare, interleaved, trips
from astb_studies.benchmarks.peers import ADDRESS, MODBUS_REPLY, MODBUS_REQUEST, REGISTERS, connected, peers
from drivers.modbus_port import open_modbus

TRIPS, QUICK_TRIPS = 500, 200
#: Target: largest ratio of the server's time to that of a server in C.
SERVER_AIM: Final = 1.5


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
                raise RuntimeError("an answer is incomplete")

        try:
            directory = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            command = str(gcc.compiled("modbus_server.c", directory, "-l:libmodbus.so.5"))
        except Skipped as reason:
            return Section("Modbus/TCP", (), (f"Skipped: {reason}.",))
        server = stack.enter_context(child(command))
        libmodbus = stack.enter_context(connected(int(server.stdout.readline())))

        found = interleaved(
            effort.repetitions,
            {
                "libmodbus": lambda: trips(lambda: exchange(libmodbus), count),
                "raw": lambda: trips(lambda: exchange(raw), count),
                "server": lambda: trips(lambda: exchange(bare), count),
                "client": lambda: trips(lambda: client.read_input(ADDRESS, REGISTERS), count),
            },
        )
    against = "raw TCP, the same bytes"
    rows = (
        compare(
            "request and answer, bare client",
            found["server"],
            "libmodbus' server",
            found["libmodbus"],
            aim="at most 1.5×",
            met=median(found["server"]) <= SERVER_AIM * median(found["libmodbus"]),
        ),
        compare("request and answer, drivers (pymodbus)", found["client"], against, found["raw"]),
        compare("request and answer, bare client", found["server"], against, found["raw"]),
    )
    notes = (
        f"Reading {REGISTERS} input registers (FC 4) of a rig in another process, medians. The bare client sends the "
        "request as bytes and decodes nothing: what is over the raw socket's time is our server's and the rig's. "
        "libmodbus answers from a map of zeros, in C, and serves one client.",
    )
    return Section("Modbus/TCP", rows, notes)
