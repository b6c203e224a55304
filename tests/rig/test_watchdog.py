"""Loss of command: HOLD at 100 ms, DISABLED at 500 ms, at once when the connection closes; by what the wires say."""

import numpy as np
import pytest

from bench_protocol.table import TABLE
from bench_sim.rig.controls import TICK_NS
from tests.rig.conftest import STREAM


def test_silence_holds_at_100_ms_and_disables_at_500_ms(armed) -> None:
    """To the tick: the last command came with the rig's time at the beginning of the silence."""
    rig = armed.rig
    start = rig._controls["tick"] - 20  # commander.cycle lets 20 ticks pass after its last frames
    states = {}
    for _ in range(600):
        rig.tick()
        states.setdefault(rig.state.name, int(rig._controls["tick"] - start))
    assert states["FAULT_REACTION"] == 100
    assert states["FAULT_HOLD"] == 101
    assert states["FAULT_DISABLED"] == 500


def test_all_wires_report_the_reason(armed) -> None:
    armed.wait(120)
    assert armed.state == "FAULT_HOLD"
    assert TABLE["rig.reason"].choices[int(armed.read("rig.reason"))] == "command late"
    assert armed.read("rig.status_code") == 400
    assert armed.read("emergency.code") == 0x8130
    contacts = armed.ask(b"\x02\0\0\0\x07")[2]
    assert contacts & 0b100000, "the fault contact"


def test_a_fault_is_latched_until_a_rising_edge_of_reset(armed) -> None:
    armed.wait(120)
    armed.cycle(20)
    assert armed.state == "FAULT_HOLD"
    armed.cycle(2, control_reset=1)
    assert armed.state == "HOLD", "M is still set, but moving again needs its edge"
    armed.cycle(2, control_reset=0, control_active=0)
    armed.cycle(2, control_active=1)
    assert armed.state == "ACTIVE"
    assert armed.read("emergency.code") == 0


def test_holding_means_that_the_set_point_stands_still(armed) -> None:
    armed.apply(lateral_control=2)
    armed.cycle(100, lateral_displacement_setpoint=0.010)
    armed.values[TABLE.index["lateral.displacement_setpoint"]] = 0.030
    armed.cycle(1)
    armed.wait(100)
    assert armed.state == "FAULT_HOLD"
    armed.wait(300)
    held = armed.read("lateral.displacement")
    assert 0.009 < held < 0.031
    armed.wait(60)
    assert armed.read("lateral.displacement") == pytest.approx(held, abs=0.0004)


def test_reading_feeds_no_watchdog(armed) -> None:
    for _ in range(120):
        armed.ask(b"\x04\0\0\0\x07")
        armed.wait(1)
    assert armed.state == "FAULT_HOLD"


def test_spoilt_commands_feed_no_watchdog(armed) -> None:
    send = armed.rig.receive

    def spoil(block: np.ndarray, peer: str) -> None:
        spoilt = block.copy()
        spoilt["data"][:, 0] ^= 1
        send(spoilt, peer)

    armed.rig.receive = spoil
    armed.cycle(7)
    assert armed.state == "FAULT_HOLD"
    assert armed.rig.values[TABLE.index["rig.rejected_commands"]] == 7 * len(STREAM)


def test_a_closed_connection_holds_within_two_ticks(armed) -> None:
    armed.rig.peer_lost(armed.peer)
    armed.rig.run(2)
    assert armed.rig.state.name == "FAULT_HOLD"
    armed.wait(20)
    assert TABLE["rig.reason"].choices[int(armed.read("rig.reason"))] == "commander disconnected"


def test_another_clients_closed_connection_has_no_effect(armed) -> None:
    armed.rig.peer_lost("can:2")
    armed.cycle(5)
    assert armed.state == "ACTIVE"


def test_a_second_commander_is_ignored(armed) -> None:
    intruder = type(armed)(armed.rig, 2)
    intruder.set_token(armed.token)
    for _ in range(10):
        intruder.cycle(1, control_enable=0)
        armed.cycle(1)
    assert armed.state == "ACTIVE"


@pytest.mark.parametrize("batch", [1, 7, 600])
def test_the_watchdog_acts_at_the_same_tick_however_time_is_run(armed, batch: int) -> None:
    rig = armed.rig
    frames = []
    for _ in range(600 // batch):
        frames.append(rig.run(batch))
    block = np.concatenate(frames)
    emergency = block[block["id"] == 0x081]
    first = emergency["time"][0] // TICK_NS - (armed.rig._controls["command_tick"])
    assert first == 100
