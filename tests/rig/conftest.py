"""A rig on the test's own bench: commands go in as frames and requests, everything is read back from frames."""

from collections.abc import Callable

import numpy as np
import pytest

from bench_protocol.can_codec import Decoder, Encoder
from bench_protocol.frames import Block
from bench_protocol.table import TABLE
from bench_protocol.words import CONTROL_MODES, SIDES, STATES
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig

#: What a commander sends each cycle.
STREAM = [message for message in TABLE.messages if not message.from_rig and message.rate]

CYCLE = 20  # ticks between commands


class Commander:
    """Uses a rig only by bytes; one method call is one 20 ms cycle or many.

    It takes the lease before its first command, unless a token was given to it.
    """

    def __init__(self, rig: Rig, number: int = 1) -> None:
        self.rig, self.peer, self.modbus = rig, f"can:{number}", f"modbus:{number}"
        self.token: int | None = None
        self.decoder = Decoder(TABLE, from_rig=True)
        self.values = np.zeros(len(TABLE.signals))
        self._encoder = Encoder(TABLE)
        self._rows = self._encoder.rows([message.name for message in STREAM])
        self._transaction = 0

    def read(self, name: str) -> float:
        """Return the last value of ``name`` that came by CAN."""
        return float(self.decoder.latest[TABLE.index[name]])

    @property
    def state(self) -> str:
        """The state that the rig publishes."""
        return STATES[int(self.read("rig.state"))]

    def wait(self, ticks: int) -> None:
        """Let time pass without commanding."""
        self.decoder.decode(self.rig.run(ticks))

    def take_lease(self) -> None:
        """Become the commander."""
        assert self.ask(b"\x06\0\0\0\x01")[0] == 6
        self.set_token(int.from_bytes(self.ask(b"\x03\0\0\0\x01")[2:], "big"))

    def set_token(self, token: int) -> None:
        """Command with any ``token``."""
        self.token = token
        self.values[TABLE.index["control.token"]] = token
        self._encoder.bind(token)

    def frames(self, *names: str) -> Block:
        """Return the present values in the messages ``names``, without names in all that are streamed."""
        rows = self._encoder.rows(names) if names else self._rows
        return self._encoder.encode(self.values, rows, 0)

    def cycle(self, count: int = 1, **settings: float) -> None:
        """Send commands for ``count`` cycles; ``control_hold=1`` sets ``control.hold`` and so on."""
        for name, value in settings.items():
            self.values[TABLE.index[_signal(name)]] = value
        if self.token is None:
            self.take_lease()
        for _ in range(count):
            self.rig.receive(self.frames(), self.peer)
            self.wait(CYCLE)

    def ask(self, pdu: bytes, peer: str | None = None) -> bytes:
        """Return the PDU that answers a Modbus request PDU."""
        self._transaction += 1
        head = self._transaction.to_bytes(2, "big") + b"\0\0" + (len(pdu) + 1).to_bytes(2, "big") + b"\1"
        answer = self.rig.answer(head + pdu, self.modbus if peer is None else peer)
        assert answer[:4] == head[:4]
        return answer[7:]

    def coil(self, name: str, peer: str | None = None) -> bytes:
        """Set the coil of an action; return the answer's PDU."""
        address = next(r.address for r in TABLE.registers if r.signal == f"action.{name}")
        return self.ask(b"\x05" + address.to_bytes(2, "big") + b"\xff\x00", peer)

    def stage(self, peer: str | None = None, **settings: float) -> list[bytes]:
        """Write settings to their holding registers; return the answers."""
        answers = []
        for name, value in settings.items():
            signal = _signal(name)
            address = next(r.address for r in TABLE.registers if r.signal == signal and r.space == "holding")
            data = np.array([value], ">f4").tobytes()
            answers.append(self.ask(b"\x10" + address.to_bytes(2, "big") + b"\0\2\4" + data, peer))
        return answers

    def apply(self, **settings: float) -> None:
        """Stage and apply settings, all of which must be accepted."""
        for answer in self.stage(**settings):
            assert answer[0] == 0x10, answer
        assert self.coil("apply")[0] == 5

    def arm(self) -> None:
        """Bring the rig from power-on to ACTIVE."""
        self.wait(500)
        self.cycle(2, control_enable=1)
        self.cycle(2, control_reset=1)
        assert self.coil("air_high")[0] == 5
        self.cycle(2, control_reset=0, control_hold=1)
        self.cycle(2, control_active=1)
        assert self.state == "ACTIVE"

    def hold_height(self) -> None:
        """Make the vertical actuators hold the bolster in place, because the air would lift it."""
        here = {
            f"vertical_{side}_displacement_setpoint": self.read(f"vertical_{side}.displacement")
            for side in SIDES
        }
        self.cycle(2, **here)
        self.apply(vertical_control=CONTROL_MODES.index("displacement"))


def _signal(name: str) -> str:
    return next(s.name for s in TABLE.signals if s.name.replace(".", "_") == name)


@pytest.fixture(scope="session")
def parameters():
    return load("astb")


@pytest.fixture
def make_rig(parameters) -> Callable[..., Rig]:
    return lambda seed=1, **changes: Rig(parameters.with_values(**changes), seed=seed)


@pytest.fixture
def commander(make_rig) -> Commander:
    return Commander(make_rig())


@pytest.fixture
def armed(commander: Commander) -> Commander:
    commander.arm()
    return commander
