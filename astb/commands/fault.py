"""`astb rig fault`: faults of a running simulated rig."""

from typing import Any, Final

import click
import msgspec

from astb.commands.options import RIG_OPTION, pairs, read_rig
from astb.exit_codes import blocked, misuse

_PORT: Final = click.option(
    "--modbus-port",
    type=click.IntRange(1, 65535),
    help="TCP port of the Modbus server of the rig.  [default: from the rig file]",
)


@click.group("fault")
def fault_command() -> None:
    """Switch faults of a running simulated rig on or off.

    The commands use a local socket of the rig, not CAN or Modbus.
    """


@fault_command.command("list")
@RIG_OPTION
@_PORT
def list_command(rig_named: str | None, modbus_port: int | None) -> None:
    """List all faults, their parameters, and the active faults."""
    answer = _send_order(rig_named, modbus_port, {"do": "list"})
    on = answer["on"]
    place = ""
    for fault in answer["faults"]:
        if fault["place"] != place:
            place = fault["place"]
            click.echo(f"{place}:")
        click.echo(f"  {fault['name']:<22} {fault['title']}")
        for one in fault["parameters"]:
            usual = f", usually {one['usual']}" if one["usual"] else ""
            click.echo(f"      {one['name']:<18} {_short(one['span'])}{usual}")
    click.echo(f"on at {answer['time']:.3f} s:" if on else f"no fault is on at {answer['time']:.3f} s")
    for active in on:
        click.echo(f"  {_active_text(active)}")


@fault_command.command("on")
@click.argument("name")
@click.argument("values", nargs=-1, metavar="[KEY=VALUE]...")
@click.option(
    "--for",
    "lasting",
    metavar="TIME",
    help="Switch the fault off after this time, such as 3s; otherwise never.",
)
@RIG_OPTION
@_PORT
def on_command(
    name: str, values: tuple[str, ...], lasting: str | None, rig_named: str | None, modbus_port: int | None
) -> None:
    """Switch a fault on, or change its values.

    For example: astb rig fault on leak side=left area=2mm2
    """
    order: dict[str, Any] = {
        "do": "on",
        "name": name,
        "values": pairs(values, "has no value; write KEY=VALUE, such as area=2mm2"),
    }
    if lasting is not None:
        order["for"] = lasting
    for active in _send_order(rig_named, modbus_port, order)["on"]:
        click.echo(f"on: {_active_text(active)}")


@fault_command.command("off")
@click.argument("name", metavar="NAME|all")
@RIG_OPTION
@_PORT
def off_command(name: str, rig_named: str | None, modbus_port: int | None) -> None:
    """Switch a fault off, or all faults.

    NAME is a fault such as leak, or a fault at one place such as leak.left.
    """
    off = _send_order(rig_named, modbus_port, {"do": "off", "name": name})["off"]
    click.echo(f"off: {', '.join(off)}" if off else "no fault was on")


def _send_order(rig_named: str | None, modbus_port: int | None, order: dict[str, Any]) -> Any:
    """Return the answer of the rig to ``order``. The command ends if there is no rig, or if the rig refuses."""
    from bench_sim.rig.control_socket import ask, control_path

    rig, path = read_rig(rig_named)
    if rig.simulation is None:
        misuse(f"rig file {path} describes a real rig (no [simulation] table); faults need a simulated rig")
    port = modbus_port or rig.modbus.port
    socket_path = control_path(rig.modbus.host, port)
    try:
        answer: dict[str, Any] = msgspec.json.decode(ask(socket_path, msgspec.json.encode(order)))
    except (FileNotFoundError, ConnectionRefusedError):
        beside = f" --modbus-port {modbus_port}" if modbus_port else ""
        blocked(f"no rig answers at {socket_path}; start it with `astb rig --rig {path}{beside}`")
    except OSError as error:
        blocked(error)
    if "error" in answer:
        misuse(answer["error"])
    return answer


def _active_text(active: dict[str, Any]) -> str:
    values = " ".join(f"{key}={value}" for key, value in active["values"].items())
    until = "" if active["until"] is None else f", until {active['until']:.3f} s"
    return f"{active['label']} {values}".strip() + f" (since {active['since']:.3f} s{until})"


def _short(span: str) -> str:
    """Return the choices of a parameter, the first five if there are many."""
    choices = span.split(" or ")
    return " | ".join(choices if len(choices) < 8 else [*choices[:5], f"… ({len(choices)})"])
