"""The kinds of loss: the removed part of a running plan, at which instant, and whether it comes back."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench_protocol.units import ms, s

if TYPE_CHECKING:
    from tests.system.next_plan.stand import First


class Gone(BaseException):
    """The process of the plan is no more: nothing of it is carried out any further."""


@dataclass(frozen=True)
class Loss:
    """One kind of loss: ``lose`` is done at its instants (s after the first), whatever the plan then does itself.

    ``of`` is the lost part, of which there are others. ``stays``: the faults that stay, by the names of the rig's
    fault panel; without any the next plan must run.
    """

    of: str
    name: str
    lose: Callable[["First"], None]
    again: tuple[float, ...] = ()
    stays: frozenset[str] = frozenset()


def _killed(first: "First") -> None:
    first.mute()
    first.leave("can")
    first.leave("modbus")
    raise Gone


def _stopped(first: "First") -> None:
    first.mute()
    raise Gone


def _interrupted(first: "First") -> None:
    del first
    raise KeyboardInterrupt


def _closed(*wires: str) -> Callable[["First"], None]:
    def lose(first: "First") -> None:
        for wire in wires:
            first.leave(wire)

    return lose


def _hole(*wires: str) -> Callable[["First"], None]:
    return lambda first: first.mute(*wires)


def _fault(name: str, lasting: float | None = None, **values: str) -> Callable[["First"], None]:
    order = {"do": "on", "name": name, "values": values}
    if lasting is not None:
        order["for"] = f"{lasting:g} s"

    def lose(first: "First") -> None:
        answer = json.loads(first.memory.rig.order(json.dumps(order).encode()))
        assert "error" not in answer, answer

    return lose


def _short_and_held(of: str, name: str, lasting: float, fault: str = "", **values: str) -> tuple[Loss, Loss]:
    fault = fault or name.replace(" ", "_")
    return (
        Loss(of, f"{name}, {lasting:g} s", _fault(fault, lasting, **values)),
        Loss(of, f"{name}, and stays", _fault(fault, **values), stays=frozenset({fault})),
    )


def _restart(first: "First") -> None:
    first.restart_the_rig()


_SPURIOUS = 200 * ms

LOSSES: tuple[Loss, ...] = (
    Loss("plan", "plan killed", _killed),
    Loss("plan", "plan stopped (SIGSTOP)", _stopped),
    Loss("plan", "interrupted once", _interrupted),
    Loss("plan", "interrupted twice", _interrupted, (1 * s,)),
    Loss("plan", "interrupted thrice", _interrupted, (1 * s, 2 * s)),
    Loss("connection", "CAN closed", _closed("can")),
    Loss("connection", "Modbus closed", _closed("modbus")),
    Loss("connection", "both closed", _closed("can", "modbus")),
    Loss("black hole", "CAN a black hole", _hole("can")),
    Loss("black hole", "Modbus a black hole", _hole("modbus")),
    Loss("black hole", "both black holes", _hole("can", "modbus")),
    *_short_and_held("interface", "interface down", 3 * s),
    *_short_and_held("PLC", "PLC hung", 3 * s, "hung_plc"),
    Loss("PLC", "PLC restarted", _fault("plc_restart", 3 * s)),
    *_short_and_held("emergency stop", "emergency stop", 1 * s, "estop"),
    Loss("power", "power contact opens", lambda first: first.memory.rig.cut_power()),
    *_short_and_held("power", "mains lost", 1 * s, "power_loss"),
    *_short_and_held("supply", "air supply lost", 5 * s, "supply_loss"),
    Loss("limit", "limit of the height", _fault("bias", _SPURIOUS, sensor="left.height", value="150 mm")),
    Loss("limit", "overload", _fault("bias", _SPURIOUS, sensor="vertical_left.force", value="200 kN")),
    Loss("limit", "overpressure", _fault("bias", _SPURIOUS, sensor="left.bellows_pressure", value="9.5 bar")),
    *_short_and_held(
        "transducer",
        "pressure transducer dead",
        3 * s,
        "broken_wire",
        sensor="left.bellows_pressure",
        reads="nothing",
    ),
    *_short_and_held(
        "transducer", "height laser dead", 3 * s, "broken_wire", sensor="left.height", reads="nothing"
    ),
    *_short_and_held("checksums", "wrong checksums", 3 * s, "wrong_crc"),
    Loss("rig", "rig restarted", _restart),
)
