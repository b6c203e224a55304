"""`astb panel`: a web page that shows and controls a rig."""

import errno
import socket
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from astb.commands.ending import UNAWARES, end_in_order, ended_by
from astb.commands.options import RIG_OPTION, SEED, out_option, read_rig
from astb.exit_codes import blocked, misuse
from bench_protocol.clock import RealClock
from bench_protocol.extras import installed, lacking
from drivers.errors import BenchError

if TYPE_CHECKING:
    from starlette.types import ASGIApp

    from astb.panel.access import Access
    from astb.panel.watch import Watch


_LOCAL: Final = "127.0.0.1"


@click.command("panel")
@RIG_OPTION
@click.option("--host", default=_LOCAL, show_default=True, help="IP address to listen on; 0.0.0.0 means all.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=8137,
    show_default=True,
    help="TCP port, or 0 for any free port.",
)
@click.option(
    "--name",
    "names",
    multiple=True,
    help="Also accept this host name; repeatable.",
)
@click.option(
    "--seed",
    type=SEED,
    help="Random seed of the sensors, if the panel starts the rig.  [default: from the rig file]",
)
@click.option(
    "--opcua",
    type=click.IntRange(0, 65535),
    metavar="PORT",
    help="Also serve the readings by OPC UA on this TCP port, read-only; 0 for any free port.",
)
@click.option(
    "--mqtt",
    metavar="HOST:PORT",
    callback=lambda _, __, text: None if text is None else _host_and_port(text),
    help="Also publish the readings to this MQTT 5 broker.",
)
@out_option("Folder for the runs.")
def panel_command(
    rig_named: str | None,
    host: str,
    port: int,
    names: tuple[str, ...],
    seed: int | None,
    opcua: int | None,
    mqtt: tuple[str, int] | None,
    out: Path,
) -> None:
    """Serve a web page that shows a rig, and starts and stops runs.

    It prints two addresses: one can only watch, the other can also control the rig. If a simulated rig does not answer,
    the panel starts it. A run continues when the panel ends, and the next panel shows it.
    """
    from astb.panel.access import Access, kept_token
    from astb.panel.answers import Parts
    from astb.panel.kept_rig import KeptRig
    from astb.panel.runs import Runs
    from astb.panel.server import application
    from astb.panel.watch import Watch

    end_in_order()
    rig, path = read_rig(rig_named)
    if rig.time == "virtual":
        misuse(f"rig file {path} has virtual time, and cannot be watched; choose a rig in real time")
    sockets = [_listening(host, port)]
    port = sockets[0].getsockname()[1]
    with ExitStack() as stack:
        stack.callback(sockets[0].close)
        kept = KeptRig(rig, path, seed, click.echo)
        stack.callback(kept.close)
        try:
            kept.ensure()
            watch = Watch(rig, path)
        except ValueError as error:
            misuse(error)
        except BenchError as error:
            blocked(error)
        runs = Runs(watch, out, kept)
        watch.revive = lambda: None if runs.going else kept.ensure()
        access = Access(kept_token(path), port, RealClock())
        parts = Parts(watch, runs, access, out)
        watch.start()
        stack.callback(watch.close)
        if opcua is not None:
            _serve_readings(stack, watch, host, opcua)
        if mqtt is not None:
            _publish_readings(stack, watch, *mqtt)
        _serve(
            application(parts, host=host, names=names),
            access,
            sockets,
            lambda: _print_addresses(host, port, access.token, names),
        )
        if runs.going:
            click.echo("the run continues; to watch it, start `astb panel` again")


def _serve_readings(stack: ExitStack, watch: "Watch", host: str, port: int) -> None:
    """Serve the readings by OPC UA until ``stack`` ends."""
    if not installed("opcua"):
        misuse(lacking("opcua", "readings by OPC UA"))
    from astb.panel.opcua_server import OpcUaServer

    try:
        server = OpcUaServer(watch, host, port)
    except BenchError as error:
        blocked(f"{error}, with --opcua PORT")
    stack.callback(server.close)
    click.echo(f"OPC UA:      {server.url}")


def _publish_readings(stack: ExitStack, watch: "Watch", host: str, port: int) -> None:
    """Publish the readings by MQTT until ``stack`` ends."""
    if not installed("mqtt"):
        misuse(lacking("mqtt", "readings by MQTT"))
    from astb.panel.mqtt_publisher import MqttPublisher

    try:
        publisher = MqttPublisher(watch, host, port, lambda line: click.echo(line, err=True))
    except BenchError as error:
        blocked(f"{error}, or name another one with --mqtt")
    stack.callback(publisher.close)
    click.echo(f"MQTT:        {publisher.url}")


def _host_and_port(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise click.BadParameter(
            f"{text!r} is not an address of a broker; write HOST:PORT, such as 127.0.0.1:1883"
        )
    return host.strip("[]"), int(port)


def _serve(app: "ASGIApp", access: "Access", sockets: list[socket.socket], tell: Callable[[], None]) -> None:
    """Serve until a signal ends the panel.

    ``tell`` prints the addresses, after the handlers of signals are installed.
    """
    from astb.panel.connections import Server

    server = Server(app, access)

    def end(by: str) -> None:
        server.should_exit = True
        if by in UNAWARES:
            click.echo(f"astb: the panel was ended by {by}", err=True)

    # Not uvicorn's own: it raises the signal again at the end, which would kill this process with open sockets.
    server.capture_signals = nullcontext  # type: ignore[method-assign, assignment]
    with ended_by(end):
        tell()
        server.run(sockets=sockets)


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    one = socket.socket(family)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        one.bind((host, port))
        one.listen()  # a reader of the address may connect before the server is ready
    except OSError as error:
        one.close()
        right = (
            "choose another port with --port"
            if error.errno == errno.EADDRINUSE
            else "check --host and --port"
        )
        blocked(f"{host}:{port} cannot be served: {error.strerror}; {right}")
    return one


def _print_addresses(host: str, port: int, token: str, names: tuple[str, ...] = ()) -> None:
    name = (
        names[0]
        if names
        else socket.gethostname()
        if host in {"0.0.0.0", "::"}
        else f"[{host}]"
        if ":" in host
        else host
    )
    if host != _LOCAL:
        click.echo("served to other machines without encryption: anyone on the network can read the token")
    click.echo(f"to watch:    http://{name}:{port}/")
    click.echo(f"to command:  http://{name}:{port}/#token={token}")
