"""A wiring that a file describes, over transports in memory and in virtual time."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.clock import VirtualClock
from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm, ms, s
from bench_protocol.words import STATES
from drivers.errors import LinkLost, MapMismatch, Misuse, NotAvailable, Refused, WiringError
from drivers.wiring.contract import Refusal, Remark
from drivers.wiring.described import DescribedWiring
from drivers.wiring.description import describe
from drivers.wiring.lines import listening
from tests.drivers.strange_rig import PointsInMemory
from tests.refusals import refuses

TEXT = """
latency = "40 ms"
functions = "FUNCTIONS"
identity = { "plc.device" = 4711 }
[transports]
plc = { kind = "modbus" }
bus = { kind = "can" }

[signals]
"rig.state" = { from = "plc.state", choices = { DISABLED = [0, 1], HOLD = 2, ACTIVE = 3 } }
"left.height" = { from = "plc.left_height", unit = "mm", sign = -1 }
"lateral.force" = { from = ["plc.f1", "bus.F2"], value = "f1 + F2", unit = "kN" }
"supply.pressure" = { from = "plc.slow_pressure", unit = "bar" }
"interlock.estop" = { from = "plc.estop", choices = { off = 1, on = 0 } }
"load_cell.1" = { from = "bus.C1", function = "cell", unit = "kN" }
"vertical_left.force_setpoint" = { to = "bus.Left", unit = "kN", sign = -1 }
"vertical_right.force_setpoint" = { to = "bus.Right", unit = "kN" }
"lateral.displacement_setpoint" = { to = "plc.lateral", unit = "mm" }
"platform.roll_setpoint" = { to = "plc.roll", unit = "mrad" }
"air.left_mode" = { to = "plc.mode", read = "plc.mode_active", choices = { hold = 0, fill = [5, 6] }, within = "1 s" }
"air.left_target" = { to = "plc.target", read = "plc.target_active", unit = "bar" }
"air.dpv" = { fixed = "on" }
"vertical.control" = { to = "plc.vertical", choices = { force = 1, displacement = 2 }, initial = "force" }
"lateral.control" = { fixed = "displacement" }
"air.right_mode" = { to = "plc.right_mode", choices = { hold = 0, fill = 5 } }
"action.power_off" = { to = "plc.command", value = [7, 0] }
"left.auxiliary_temperature" = { absent = "no thermometer in the chambers" }
[player]
lever = "1.5 m"
"""
PLC = ("device", "state", "left_height", "f1", "slow_pressure", "estop", "lateral", "roll", "mode", "mode_active",
       "target", "target_active", "vertical", "right_mode", "command")  # fmt: skip


class WiredRig:
    """A third-party rig of two transports, its wiring, and everything that it reports."""

    def __init__(self, tmp_path: Path, text: str = TEXT) -> None:
        functions = tmp_path / "own.py"
        functions.write_text("def cell(x):\n    return 1 / x\n")
        self.clock = VirtualClock()
        self.plc = PointsInMemory(dict.fromkeys(PLC, 0.0), asked=["slow_pressure", "device"])
        self.plc.points |= {"device": 4711, "state": 3, "estop": 1}
        self.plc.react = self._acknowledge
        self.deaf = False
        self.bus = PointsInMemory({"F2": 0.0, "C1": 1.0, "Left": 0.0, "Right": 0.0}, every=0.01)
        keys = tomllib.loads(text.replace("FUNCTIONS", "own.py"))
        self.description = describe(keys, tmp_path / "hall.toml", TABLE)
        self.wiring = DescribedWiring("hall", self.description, {"plc": self.plc, "bus": self.bus})
        self.heard: list[tuple[int, str, float]] = []
        self.lost: list[str] = []

    def _acknowledge(self, point: str, number: float) -> None:
        if point in ("mode", "target") and not self.deaf:
            self.plc.points[f"{point}_active"] = number

    def open(self, within: float = 1 * s) -> "WiredRig":
        def receive(times, rows, values, arrived):
            names = [TABLE.signals[row].name for row in rows]
            self.heard += zip(times.tolist(), names, values.tolist(), strict=True)

        self.wiring.open(self.clock, receive, self.lost.append, within=within)
        return self

    def wait(self, duration: float) -> None:
        self.clock.sleep_until(self.clock.now() + round(duration * 1e9))

    def last(self, name: str) -> float:
        return [value for _, one, value in self.heard if one == name][-1]

    def cycle(self, count: int = 1, **setpoints: float) -> list[dict[str, float]]:
        """Send set-points for so many cycles of 20 ms; return the streamed values, transports together."""
        values = np.full(len(TABLE.signals), np.nan)
        for name, value in setpoints.items():
            values[TABLE.index[name.replace("__", ".")]] = value
        streamed = []
        for _ in range(count):
            self.wait(20 * ms)
            self.plc.streams.clear()
            self.bus.streams.clear()
            self.wiring.outlet.send(values, self.clock.now())
            streamed.append(
                {k: v for _, told in self.plc.streams + self.bus.streams for k, v in told.items()}
            )
        return streamed


@pytest.fixture
def wired(tmp_path):
    return WiredRig(tmp_path)


# -- received values -------------------------------------------------------------------------------------------------


def test_points_become_signals_in_si_with_the_time_at_which_they_came(wired):
    wired.plc.points["left_height"] = 12.5
    wired.open()
    wired.wait(50 * ms)
    time, _, value = next(one for one in wired.heard if one[1] == "left.height")
    assert value == pytest.approx(-12.5 * mm)
    assert time % 50_000_000 == 0
    assert STATES[int(wired.last("rig.state"))] == "ACTIVE"


def test_all_transports_are_notified_of_set_points(wired):
    wired.open()
    wired.cycle()
    assert wired.plc.streams == wired.bus.streams == [], "nothing was given yet"
    wired.cycle(vertical_left__force_setpoint=1 * kN)
    assert [points for _, points in wired.bus.streams] == [{"Left": -1.0}]
    assert [points for _, points in wired.plc.streams] == [{}], "its sign of life hangs on it"


def test_a_value_of_two_transports_is_new_when_the_last_of_its_points_came(wired):
    wired.plc.points["f1"], wired.bus.points["F2"] = 3.0, 4.0
    wired.open()
    wired.heard.clear()
    wired.wait(0.5)
    forces = [(time, value) for time, name, value in wired.heard if name == "lateral.force"]
    assert [value for _, value in forces] == pytest.approx([7 * kN] * 10)
    assert np.diff([time for time, _ in forces]) == pytest.approx([50_000_000] * 9)


@pytest.mark.parametrize("number", [math.inf, -math.inf])
def test_infinite_readings_are_not_available(wired, number):
    """An infinite pressure would be above every target."""
    wired.plc.points["left_height"] = wired.plc.points["slow_pressure"] = number
    wired.open()
    wired.wait(0.1)
    assert math.isnan(wired.last("left.height"))
    assert math.isnan(wired.wiring.read(["supply.pressure"])["supply.pressure"])


def test_a_value_one_of_whose_points_is_stale_is_none(wired):
    wired.open()
    wired.wait(0.1)
    wired.bus.silent = True  # F2 waits, with news, for f1
    wired.plc.publish("state")
    wired.bus.silent = False
    wired.bus.publish("F2")
    wired.bus.silent = wired.plc.silent = True
    wired.wait(1.0)
    wired.plc.silent = False
    wired.plc.publish("f1")
    assert math.isnan(wired.last("lateral.force"))


def test_freshness_is_that_of_the_slowest_point_and_0_for_what_is_asked(wired):
    fresh = {
        signal.name: int(limit) for signal, limit in zip(TABLE.signals, wired.wiring.freshness, strict=True)
    }
    assert fresh["left.height"] == fresh["lateral.force"] == 150_000_000
    assert fresh["load_cell.1"] == 30_000_000
    assert fresh["supply.pressure"] == fresh["interlock.estop"] == fresh["right.height"] == 0


def test_what_does_not_come_by_itself_is_read_when_asked(wired):
    wired.plc.points |= {"slow_pressure": 8.0, "estop": 0, "mode_active": 6}
    wired.open()
    told = wired.wiring.read(
        ["supply.pressure", "interlock.estop", "air.left_mode", "air.dpv", "vertical.control"]
    )
    assert told == {
        "supply.pressure": 8 * bar, "interlock.estop": 1, "air.left_mode": 2, "air.dpv": 1, "vertical.control": 1
    }  # fmt: skip
    assert math.isnan(
        wired.wiring.read(["air.right_mode"])["air.right_mode"]
    )  # never written, never reported
    assert wired.wiring.capabilities.notes == {
        "settings": "assumed to be the last written value: vertical.control, air.right_mode"
    }


def test_an_absent_signal_is_refused_with_rig_name_and_reason(wired):
    wired.open()
    for ask in (
        lambda: wired.wiring.read(["left.auxiliary_temperature"]),
        lambda: wired.wiring.write({"air.right_target": 1 * bar}),
        lambda: wired.wiring.act("action.power_on"),
    ):
        with pytest.raises(
            NotAvailable, match=r"hall has no .*: (no thermometer|the wiring does not mention it)"
        ):
            ask()


def test_a_function_of_the_users_own_that_fails_ends_the_run_in_words(wired):
    wired.bus.points["C1"] = 4.0
    wired.open()
    assert wired.last("load_cell.1") == 250.0
    wired.bus.points["C1"] = 0.0
    wired.wait(0.1)
    assert isinstance(wired.wiring.failure, Misuse)
    assert "own.py could not convert the readings of hall to signals: ZeroDivisionError" in str(
        wired.wiring.failure
    )


# -- coming and going ------------------------------------------------------------------------------------------------


def test_no_server_is_reported(wired):
    wired.bus.refusing = True
    with refuses(LinkLost, "answers"):
        wired.open()
    assert wired.plc.connections == 0  # all opened connections are closed


def test_a_silent_rig_is_reported_in_bounded_time(wired):
    wired.bus.silent = True
    with refuses(LinkLost, "within 1 s"):
        wired.open(within=1 * s)
    assert wired.clock.now() <= 1.1e9


def test_another_rig_than_the_one_described(wired):
    wired.plc.points["device"] = 12
    with refuses(MapMismatch, "plc.device 12 hall.toml 4711"):
        wired.open()


def test_a_rig_that_tells_who_it_is_in_its_turn(wired):
    """On a bus nothing can be asked: what a wiring wants to know first may come last."""
    wired.plc.points["device"] = math.nan
    ticks = iter(range(100))

    def publish():
        if next(ticks) == 5:
            wired.plc.points["device"] = 4711

    wired.clock.every(20_000_000, publish)
    wired.open()
    assert wired.clock.now() < 1e9


def test_a_blocked_close_message_keeps_no_connection_open(tmp_path):
    wired = WiredRig(tmp_path, TEXT + '[sequences]\nclose = [{ "plc.command" = 70000 }]\n').open()

    def refuse(points):
        raise ValueError("plc.command = 70000 does not fit")

    wired.plc.write = refuse
    wired.wiring.close()
    assert wired.plc.connections == wired.bus.connections == 0


def test_a_listener_sends_no_frames(tmp_path):
    wired = WiredRig(
        tmp_path, TEXT + '[sequences]\nopen = [{ "plc.command" = 1 }]\nclose = [{ "plc.command" = 2 }]\n'
    )
    for description, words in ((wired.description, [1, 2]), (listening(wired.description), [])):
        wired.plc.writes.clear()
        wiring = DescribedWiring("hall", description, {"plc": wired.plc, "bus": wired.bus})
        wiring.open(wired.clock, lambda *received: None, wired.lost.append, within=1 * s)
        wiring.close()
        assert [one["command"] for one in wired.plc.writes] == words


def test_no_data_follow_close_and_a_loss_is_reported_once(wired):
    wired.open()
    wired.plc.lose("cable out")
    wired.bus.lose("cable out too")
    assert wired.lost == ["plc: cable out"]
    wired.wiring.close()
    wired.wiring.close()
    wired.heard.clear()
    wired.wait(1.0)
    wired.cycle()
    assert not wired.heard


def test_points_that_a_transport_does_not_have(tmp_path):
    with refuses(WiringError, "signals.\"left.height\".from 'plc.hight' 'hight'"):
        WiredRig(tmp_path, TEXT.replace("plc.left_height", "plc.hight"))


def test_a_state_that_has_to_be_asked_for(wired):
    wired.plc.asked.add("state")
    with refuses(WiringError, '"rig.state".from plc.state'):
        DescribedWiring("hall", wired.description, {"plc": wired.plc, "bus": wired.bus})


def test_points_that_cannot_be_written(tmp_path, wired):
    wired.plc.locked = {"mode"}
    with refuses(WiringError, "\"air.left_mode\".to 'plc.mode'"):
        DescribedWiring("hall", wired.description, {"plc": wired.plc, "bus": wired.bus})


# -- sent values -----------------------------------------------------------------------------------------------------


def test_setpoints_are_streamed_in_the_rigs_numbers(wired):
    wired.open()
    assert wired.cycle(vertical_left__force_setpoint=20 * kN, lateral__displacement_setpoint=3 * mm) == [
        {"Left": pytest.approx(-20.0), "lateral": pytest.approx(3.0)}
    ]


def test_an_unencodable_set_point_fails_in_the_plan(wired):
    def refuse(points, time):
        raise ValueError("Set.Left = 40 is more than 10")

    wired.open()
    wired.bus.stream = refuse
    assert wired.cycle(vertical_left__force_setpoint=40 * kN, lateral__displacement_setpoint=3 * mm) == [
        {"lateral": pytest.approx(3.0)}
    ]
    assert str(wired.wiring.failure) == "set-points cannot be sent to hall: Set.Left = 40 is more than 10"


def test_settings_go_out_together_and_are_awaited(wired):
    wired.open()
    wired.wiring.write({"air.left_mode": 2, "air.left_target": 5 * bar, "air.dpv": 1})
    assert wired.plc.writes == [{"mode": 5, "target": pytest.approx(5.0)}]
    assert wired.wiring.read(["air.left_target"])["air.left_target"] == pytest.approx(5 * bar)


def test_a_setting_that_is_never_acknowledged_is_refused_and_taken_back(wired):
    wired.open()
    wired.deaf = True
    with refuses(Refused, "air.left_mode fill plc.mode_active 1 s"):
        wired.wiring.write({"air.left_mode": 2, "air.left_target": 5 * bar})
    assert wired.plc.points["mode"] == 0


def test_a_mode_must_not_change_under_a_program(wired):
    wired.open()
    setpoints = {"vertical_left__force_setpoint": 20 * kN, "vertical_right__force_setpoint": 20 * kN}
    wired.cycle(5, **setpoints)
    wired.wiring.write(
        {"generator.frequency": 1.0, "generator.cycles": 9, "generator.force_amplitude": 2 * kN}
    )
    wired.wiring.act("action.program_run")
    wired.wiring.write({"vertical.control": 1})  # as it is
    with refuses(Refused, "vertical.control"):
        wired.wiring.write({"vertical.control": 2})
    crest = [-one["Left"] for one in wired.cycle(100, **setpoints)]
    assert [min(crest), max(crest)] == pytest.approx([18, 22], abs=0.1)
    assert wired.last("rig.program") == 1
    wired.plc.points["state"] = 2  # HOLD
    wired.wait(0.1)
    assert wired.cycle(2, **setpoints)[-1]["Left"] == pytest.approx(-20)
    assert wired.last("rig.program") == 3


def test_a_failed_restore_does_not_hide_the_refusal(wired):
    wired.open()
    wired.deaf = True
    write = wired.plc.write

    def once(points):
        if wired.plc.writes:
            raise ValueError("mode = 0 does not fit")
        write(points)

    wired.plc.write = once
    with refuses(Refused, "acknowledge"):
        wired.wiring.write({"air.left_mode": 2})


def test_a_number_that_a_rig_rounds_is_acknowledged(wired):
    wired.open()
    wired.deaf = True
    wired.plc.react = lambda point, number: wired.plc.points.update({f"{point}_active": round(number, 2)})
    wired.wiring.write({"air.left_target": 5.004 * bar})


def test_a_choice_that_the_rig_does_not_have(wired):
    wired.open()
    with refuses(NotAvailable, "air.left_mode level"):
        wired.wiring.write({"air.left_target": 5 * bar, "air.left_mode": 1})
    with refuses(NotAvailable, "lateral.control force"):
        wired.wiring.write({"lateral.control": 1})
    assert wired.plc.writes == []  # all or none


def test_a_setting_without_a_way_back_is_remembered(wired):
    wired.open()
    wired.wiring.write({"air.right_mode": 2})
    assert wired.wiring.read(["air.right_mode"])["air.right_mode"] == 2


def test_actions_and_points_of_the_rigs_own(wired):
    wired.open()
    wired.wiring.act("action.power_off")
    wired.wiring.write_points({"plc.command": 3, "bus.Left": 1, "plc.mode": 2})
    assert wired.plc.writes == [{"command": 7}, {"command": 0}, {"command": 3, "mode": 2}]
    assert wired.bus.writes == [{"Left": 1}]


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 9.0))
def test_what_is_set_is_what_is_in_force(tmp_path_factory, pressure):
    wired = WiredRig(tmp_path_factory.mktemp("rig")).open()
    wired.wiring.write({"air.left_target": pressure * bar})
    assert wired.wiring.read(["air.left_target"])["air.left_target"] == pytest.approx(
        pressure * bar, abs=1e-3
    )


# -- set-points that are not taken ---------------------------------------------------------------------------------


def test_repeatedly_refused_set_points_are_a_reported_failure(wired):
    wired.plc.points["state"] = 2
    wired.open()
    wired.wait(100 * ms)
    wired.plc.refusal = Refusal(wired.clock.now(), Refused("writing lateral was refused: because", 4))
    wired.cycle(50, lateral__displacement_setpoint=1 * mm)
    assert wired.wiring.failure is None, "in HOLD it may refuse them: the way up goes on"
    wired.plc.points["state"] = 3
    wired.cycle(10, lateral__displacement_setpoint=1 * mm)
    assert wired.wiring.failure is None, "some may be lost on the way into a state"
    wired.cycle(10, lateral__displacement_setpoint=1 * mm)
    assert isinstance(wired.wiring.failure, Refused)
    assert str(wired.wiring.failure) == "hall refuses set-points on plc: writing lateral was refused: because"


def test_notices_of_transports_are_reported_by_transport(wired):
    wired.open()
    wired.plc.remarks = lambda: [Remark("3 of 7 requests got no answer", True)]
    assert wired.wiring.remarks() == {"plc": [Remark("3 of 7 requests got no answer", True)]}
