"""Round trip of a CAN frame to the hub, with our plugin, with python-can's own client, and with a raw socket."""

import contextlib
import logging
import socket
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Final

import can

from astb_studies.benchmarks.measure import Effort, Section, compare, interleaved, trips
from astb_studies.benchmarks.peers import CAN_REPLY, CAN_REQUEST, FRAME_BLOCK, connected, peers
from drivers.hub_bus import HubBus

TRIPS, QUICK_TRIPS = 500, 200
PATIENCE: Final = 5.0  # s
#: Target: largest ratio of the hub's time to that of an event loop that only answers.
HUB_AIM: Final = 1.5


def run(effort: Effort) -> Section:
    """Measure the three in turn."""
    count = QUICK_TRIPS if effort.quick else TRIPS
    logging.getLogger("can").setLevel(logging.ERROR)  # it warns of every empty read
    with contextlib.ExitStack() as stack:
        ports = stack.enter_context(peers())
        raw = stack.enter_context(connected(ports.raw_can))
        by_itself = stack.enter_context(peers())  # a hub that has one client
        echo = stack.enter_context(connected(by_itself.echo))
        bare = stack.enter_context(connected(by_itself.hub))
        for command in (b"", b"< open vcan0 >", b"< rawmode >"):
            bare.sendall(command)
            bare.recv(64)
        ours = stack.enter_context(HubBus(port=ports.hub))
        stock = stack.enter_context(
            can.Bus(
                interface="socketcand",
                channel="vcan0",
                host="127.0.0.1",
                port=ports.hub,
                tcp_tune=True,
                ignore_config=True,
            )
        )
        message = can.Message(arbitration_id=0x123, is_extended_id=False, data=bytes(range(8)))

        def exchange(sock: socket.socket) -> None:
            sock.sendall(CAN_REQUEST)
            _expect(len(sock.recv(4096)) == len(CAN_REPLY))

        def our_trip() -> None:
            ours.send_block(FRAME_BLOCK)
            _expect(len(ours.recv_block(PATIENCE)) == 1)

        def stock_trip() -> None:
            stock.send(message)
            _expect(stock.recv(PATIENCE) is not None)

        found = interleaved(
            effort.repetitions,
            {
                "raw": lambda: trips(lambda: exchange(raw), count),
                "echo": lambda: trips(lambda: exchange(echo), count),
                "bare": lambda: trips(lambda: exchange(bare), count),
                "ours": lambda: _measured(our_trip, count, lambda: stock.recv(0.01) is not None),
                "stock": lambda: _measured(stock_trip, count, lambda: len(ours.recv_block(0.01)) > 0),
            },
        )
    return _section(found)


def _section(found: Mapping[str, Sequence[float]]) -> Section:
    against = "raw TCP, the same bytes"
    rows = (
        compare(
            "round trip, bare client",
            found["bare"],
            "an echo on asyncio",
            found["echo"],
            aim="at most 1.5×",
            met=median(found["bare"]) <= HUB_AIM * median(found["echo"]),
        ),
        compare("round trip, our plugin", found["ours"], against, found["raw"]),
        compare("round trip, python-can's socketcand", found["stock"], against, found["raw"]),
    )
    notes = (
        "Client and hub in two processes, one frame of eight bytes there and back, medians. The hub passes every frame "
        "on to the other client as well. The raw peer reads and writes in a thread of its own, without an event loop. "
        "The bare client is alone with its hub, sends and expects bytes and decodes nothing.",
    )
    return Section("CAN over the hub", rows, notes)


def _measured(trip: Callable[[], None], count: int, more: Callable[[], bool]) -> float:
    """Measure, then read all frames that the other client has received meanwhile."""
    found = trips(trip, count)
    while more():
        pass
    return found


def _expect(arrived: bool) -> None:
    if not arrived:
        raise RuntimeError("a returned frame is incomplete")
