"""The rig in real time, in a separate process: the tick runs in one thread and the servers in another."""

import contextlib
import gc
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

from bench_protocol.clock import RealClock, hurry, hurry_process, wall_time_ns
from bench_protocol.runtime.eventfd import open_eventfd
from bench_protocol.runtime.pacing import Late
from bench_sim.rig.can_bus import CanBus, Stage
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.capture import Capture
from bench_sim.rig.capture_server import CaptureServer
from bench_sim.rig.control_socket import ControlSocket
from bench_sim.rig.faults.insertion import Wires
from bench_sim.rig.modbus_server import ModbusTcpServer
from bench_sim.rig.rig import Rig
from bench_sim.rig.servers import CAN_PORT, serve_in_thread
from bench_sim.rig.socketcan import SocketCan

MODBUS_PORT: Final = 15020
_TICK_PRIORITY: Final = 10


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
    ready: Callable[[str, str, str], None],
) -> None:
    """Open CAN and Modbus, call ``ready(can, modbus, control)`` with their addresses, and run ticks until ``stop`` is
    set.

    ``can`` is ``auto`` (``vcan0`` if the kernel has it, else TCP), ``tcp`` or a SocketCAN interface. Frames pass
    through ``stages`` and ``capture``. Other programs can read the capture on ``capture_port``. ``policy`` is for late
    ticks; ``host``, ``allow_remote`` and ``beacon`` are those of `serve_in_thread`. Raises OSError with an explanation
    if a port cannot be opened. On return everything is closed.
    """
    interface = find_interface() if can == "auto" else None if can == "tcp" else can
    rig.lease.draw_unpredictably()
    modbus_server = _modbus_server(rig)
    bus, wire, hub = _open_bus(rig, interface)
    with contextlib.ExitStack() as stack:
        stack.callback(bus.close)
        if wire:
            stack.callback(wire.close)
        eventfd = stack.enter_context(open_eventfd())
        servers = stack.enter_context(
            serve_in_thread(
                hub,
                modbus_server,
                CaptureServer(capture) if capture and capture_port else None,
                ControlSocket(rig.order),
                host=host,
                can_port=can_port,
                modbus_port=modbus_port,
                capture_port=capture_port or 0,
                allow_remote=allow_remote,
                beacon=beacon,
                eventfd=eventfd,
                on_wake=lambda: bus.publish(rig.collect()),
            )
        )
        for stage in (*stages, capture) if capture else stages:
            bus.add(stage)
        rig.faults.points.connect(Wires(bus, hub, modbus_server))
        bus.publish(rig.run(1))  # loads the compiled tick before the first deadline
        stack.enter_context(_undisturbed())
        with _ticking(rig, eventfd, policy, stop):
            can_address = interface or f"socketcand://{host}:{servers.can_port}"
            ready(can_address, f"{host}:{servers.modbus_port}", str(servers.control))
            stop.wait()


def _modbus_server(rig: Rig) -> ModbusTcpServer:
    """Return the Modbus server of ``rig``, with the Modbus faults between the clients and the rig."""
    faults, lease = rig.faults.points.modbus, rig.lease
    answer = faults.before(rig.answer)
    return ModbusTcpServer(
        answer, rig.peer_lost, pieces=faults.pieces, holds=lease.holds, commands=lease.commands
    )


def _open_bus(rig: Rig, interface: str | None) -> tuple[CanBus, SocketCan | None, CanHub | None]:
    """Return the bus of ``rig`` and its server. The server is a SocketCAN ``interface`` if there is one, otherwise
    the hub.
    """
    clock, started = RealClock(), wall_time_ns()

    def now() -> int:
        """Return the time for time stamps (ns). A change of the system clock does not affect it."""
        return started + clock.now()

    bus = CanBus(rig.receive, clock, now)

    def peer_lost(peer: str) -> None:
        bus.forget(peer)
        rig.peer_lost(peer)

    wire = SocketCan(interface, bus.take) if interface else None
    hub = None if wire else CanHub(rig.receive, peer_lost, carry=bus.carry, now=now, holds=rig.lease.holds)
    if server := wire or hub:
        bus.connect(server)
    return bus, wire, hub


@contextlib.contextmanager
def _ticking(rig: Rig, eventfd: int, policy: Late, stop: threading.Event) -> Iterator[None]:
    """Run the ticks of ``rig`` in a thread during the ``with`` block. An error in this thread sets ``stop`` and is
    raised at the end.
    """
    failed: list[BaseException] = []

    def tick() -> None:
        hurry(_TICK_PRIORITY)
        try:
            rig.keep_time(eventfd, policy)
        except BaseException as error:
            failed.append(error)
        finally:
            stop.set()

    thread = threading.Thread(target=tick, name="tick")
    thread.start()
    try:
        yield
    finally:
        rig.pacing.stop()
        thread.join()
    if failed:
        raise failed[0]


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Switch off the garbage collector of this process during the ``with`` block, and raise the priority of the
    process.
    """
    hurry_process()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


def find_interface() -> str | None:
    """Return ``vcan0`` if the kernel has it and it is up, otherwise None. The drivers do the same. A real bus must be
    requested by name.
    """
    try:
        flags = int(Path("/sys/class/net/vcan0/flags").read_text(encoding="ascii"), 16)
    except OSError:
        return None
    return "vcan0" if flags & 1 else None
