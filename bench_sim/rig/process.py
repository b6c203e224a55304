"""The rig in real time: a tick loop on absolute deadlines with its servers, alone in a process of its own."""

import gc
import threading
from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Final

from bench_protocol.clock import Clock, RealClock, hurry, hurry_process, relax, wall_time_ns
from bench_protocol.frames import Block
from bench_protocol.units import NS
from bench_sim.rig.can_bus import CanBus, Stage
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.capture import Capture
from bench_sim.rig.capture_server import CaptureServer
from bench_sim.rig.controls import TICK_NS
from bench_sim.rig.modbus_server import ModbusTcpServer
from bench_sim.rig.rig import Rig
from bench_sim.rig.servers import CAN_PORT, serve_in_thread
from bench_sim.rig.socketcan import SocketCan

MODBUS_PORT: Final = 15020
_TICK_PRIORITY: Final = 10
#: After a stall this long the readers get this much time first.
_STALL: Final = 20 * TICK_NS
_PAUSE: Final = 3 * TICK_NS
#: Under the policy ``fault``, the lateness that counts as a lost tick.
_LOST: Final = 0.1 * NS


class Late(StrEnum):
    """What happens to ticks whose time has passed."""

    CATCH_UP = "catch_up"  #: run them all, at once
    SKIP = "skip"  #: let the rig's time stand still for as long
    FAULT = "fault"  #: catch up, but more than 100 ms is a fault of the bench


def keep_time(
    rig: Rig,
    publish: Callable[[Block], None],
    stop: threading.Event,
    clock: Clock,
    policy: Late = Late.CATCH_UP,
) -> None:
    """Tick ``rig`` every millisecond of ``clock`` until ``stop`` is set, and publish what it sends.

    Frames leave stamped with the nominal time of their tick (Unix epoch, ns): the sampling instants are even even if
    the loop is late.
    """
    start = clock.now()
    epoch = wall_time_ns()
    beat = 0
    behind = False
    while not stop.is_set():
        beat += 1
        deadline = start + beat * TICK_NS
        clock.sleep_until(deadline)
        late = clock.now() - deadline
        if late > _STALL and not behind:
            # The machine stood still, and with it the thread that reads: commands that came in time lie in the
            # sockets. Without this pause the catching up would count them as missing and trip the watchdog.
            clock.sleep_until(clock.now() + _PAUSE)
        behind = late > _STALL
        rig.report_lateness(late / NS, lost=policy is Late.FAULT and late > _LOST)
        if policy is Late.SKIP and late >= TICK_NS:
            missed = late // TICK_NS
            start += missed * TICK_NS
            epoch += missed * TICK_NS
        block = rig.tick()
        if block.size:
            block["time"] += epoch
            publish(block)


def run_rig(
    rig: Rig,
    *,
    can: str = "auto",
    host: str = "127.0.0.1",
    can_port: int = CAN_PORT,
    modbus_port: int = MODBUS_PORT,
    allow_remote: bool = False,
    beacon: bool = False,
    policy: Late = Late.CATCH_UP,
    stages: Sequence[Stage] = (),
    capture: Capture | None = None,
    capture_port: int | None = None,
    stop: threading.Event,
    ready: Callable[[str, str], None],
) -> None:
    """Open CAN and Modbus, call ``ready(can, modbus)`` with their addresses, and tick until ``stop`` is set.

    ``can`` is ``auto`` (``vcan0`` if the kernel has it, else TCP), ``tcp`` or a SocketCAN interface; ``stages``
    stand on the bus behind it, and so does ``capture``, which lets others read along on ``capture_port``.
    Raises OSError in words if one of them cannot be opened; everything is closed on return.
    """
    interface = find_interface() if can == "auto" else None if can == "tcp" else can
    modbus_server = ModbusTcpServer(rig.answer, rig.peer_lost)
    clock = RealClock()
    bus = CanBus(rig.receive, clock, wall_time_ns)

    def peer_lost(peer: str) -> None:
        bus.forget(peer)
        rig.peer_lost(peer)

    wire = SocketCan(interface, bus.take) if interface else None
    hub = None if wire else CanHub(rig.receive, peer_lost, carry=bus.carry)
    if door := wire or hub:
        bus.connect(door)
    try:
        with serve_in_thread(
            hub,
            modbus_server,
            CaptureServer(capture) if capture and capture_port else None,
            host=host,
            can_port=can_port,
            modbus_port=modbus_port,
            capture_port=capture_port or 0,
            allow_remote=allow_remote,
            beacon=beacon,
        ) as servers:
            can_address = interface or f"socketcand://{host}:{servers.can_port}"
            for stage in (*stages, capture) if capture else stages:
                bus.add(stage)
            bus.publish(rig.run(1))  # loads the compiled tick before the first deadline
            with _real_time():
                ready(can_address, f"{host}:{servers.modbus_port}")
                keep_time(rig, bus.publish, stop, clock, policy)
    finally:
        bus.close()
        if wire:
            wire.close()


def find_interface() -> str | None:
    """Return ``vcan0`` if the kernel has it and it is up, as the drivers do; a real bus must be asked for by name."""
    try:
        flags = int(Path("/sys/class/net/vcan0/flags").read_text(encoding="ascii"), 16)
    except OSError:
        return None
    return "vcan0" if flags & 1 else None


class _real_time:  # noqa: N801 - reads as a statement
    """Inside, this thread is scheduled as sharply as the machine allows, and the garbage collector rests."""

    def __enter__(self) -> None:
        hurry_process()
        gc.collect()
        gc.freeze()
        gc.disable()
        hurry(_TICK_PRIORITY)

    def __exit__(self, *_: object) -> None:
        relax()
        gc.enable()
        gc.unfreeze()
