"""The black box, read over Modbus by pymodbus: ten seconds before and after the first trip or fault, and a story."""

import numpy as np
import pytest

from bench_protocol.black_box import CHANNELS, read_head, read_incident
from bench_protocol.modbus import FILE_READ_MAX
from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm
from bench_protocol.words import AIR_MODES, SIDES
from drivers.errors import Refused
from drivers.modbus_port import InMemoryModbus
from tests.refusals import refuses


@pytest.fixture
def port(commander):
    port = InMemoryModbus(lambda request: commander.rig.answer(request, "modbus:9"))
    yield port
    port.close()


def incident_of(port):
    return read_incident(port.read_file, FILE_READ_MAX)


def test_before_anything_has_happened_the_box_is_empty(armed, port) -> None:
    head = read_head(port.read_file)
    assert (head.number, head.samples, head.recording) == (0, 0, False)
    assert incident_of(port).samples.shape == (len(CHANNELS), 0)
    with refuses(Refused, "outside"):
        port.read_file(2, 0, 1)


def test_ten_seconds_before_and_after_a_trip_are_what_came_by_can(armed, port) -> None:
    """Against the frames of the same time: sample by sample, to the step of the wire."""
    names = ("left.height", "vertical_left.force", "left.bellows_pressure", "supply.pressure", "rig.state")
    received: dict[str, list[tuple[int, float]]] = {name: [] for name in names}

    def wait(ticks: int) -> None:
        samples = armed.decoder.decode(armed.rig.run(ticks))
        for name in names:
            mine = samples.signals == TABLE.index[name]
            received[name] += zip(samples.times[mine].tolist(), samples.values[mine].tolist(), strict=True)

    armed.wait = wait
    armed.hold_height()
    armed.apply(**{f"air_{side}_mode": AIR_MODES.index("fill") for side in SIDES}, air_left_target=1 * bar)
    armed.cycle(550)
    armed.cycle(70, lateral_force_setpoint=50 * kN)
    assert armed.state == "FAULT_HOLD"
    tripped = armed.read("rig.tripped_tick")
    armed.wait(1000)
    assert read_head(port.read_file).recording
    armed.wait(10_000)
    incident = incident_of(port)
    assert (incident.number, incident.tick) == (1, tripped)
    assert incident.times[[0, -1]].tolist() == [-10.0, 10.0]
    for name in names:
        times, values = np.array(received[name]).T
        shown = np.interp((times / 1e6 - incident.tick) / 1000, incident.times, incident.values(name))
        inside = np.abs(times / 1e6 - incident.tick) <= 9_990
        if name == "rig.state":
            assert set(incident.values(name)) <= {7.0, 8.0, 9.0, 10.0}
            continue
        assert inside.sum() > 150
        assert np.abs(shown - values)[inside].max() <= 0.5001 * TABLE[name].step, name


def test_the_story_says_what_tripped_what_had_gone_before_and_how_it_ended(armed, port) -> None:
    armed.hold_height()
    armed.apply(
        **{f"air_{side}_mode": AIR_MODES.index("fill") for side in SIDES},
        air_left_target=2 * bar,
        air_right_target=2 * bar,
    )
    armed.cycle(500)
    armed.cycle(100, **{f"vertical_{side}_displacement_setpoint": 100 * mm for side in SIDES})
    assert armed.state == "FAULT_DISABLED"
    armed.wait(10_000)
    lines = incident_of(port).story.splitlines()
    assert lines[0].startswith("00:00:1")
    assert "left height above 90 mm for 20 ms, predicted 30 ms ahead, at 9" in lines[0]
    assert lines[0].endswith("→ interlock")
    assert lines[1].startswith("  before: left height went from -5"), lines[1]
    assert any("bellows pressure went from" in line for line in lines)
    assert any(line.endswith("tripped: ACTIVE → FAULT_REACTION") for line in lines)
    assert lines[-1].startswith("  after: state FAULT_DISABLED 10 s after the trip")


def test_the_first_incident_stays_until_a_reset_and_the_next_takes_its_place(armed, port) -> None:
    armed.wait(700)  # without commands: held after 100 ms, disabled after 500
    armed.wait(10_000)
    first = incident_of(port)
    assert "no valid command for 100 ms" in first.story.splitlines()[0]
    assert "no valid command for 500 ms: FAULT_HOLD → FAULT_DISABLED" in first.story
    armed.rig.press_estop()
    armed.wait(11_000)
    assert incident_of(port).number == 1, "what follows is a consequence of the first"
    armed.rig.release_estop()
    armed.take_lease()  # after such a silence the lease is lost
    armed.cycle(2, control_enable=1, control_hold=0, control_active=0, control_reset=0)
    armed.cycle(2, control_reset=1)
    assert armed.state == "DISABLED"
    armed.rig.press_estop()
    armed.wait(9_000)
    assert incident_of(port).number == 1, "it stands until the new one is complete"
    armed.wait(2_000)
    second = incident_of(port)
    assert second.number == 2
    assert "emergency stop pressed" in second.story.splitlines()[0]


def test_an_incident_soon_after_the_start_has_what_there_was(make_rig, commander, port) -> None:
    commander.wait(500)
    commander.rig.press_estop()
    commander.wait(10_100)
    incident = incident_of(port)
    assert incident.trigger == 99
    assert incident.samples.shape[1] == 100 + 2000
