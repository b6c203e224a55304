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
from drivers.wiring.listening import listening
from tests.drivers.strange_rig import PointsInMemory

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


class Stand:
    """A strange rig of two transports, its wiring, and everything that it tells."""

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

    def open(self, within: float = 1 * s) -> "Stand":
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
        """Send set-points on so many cycles of 20 ms; return what was streamed on them, transports together."""
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
def stand(tmp_path):
    return Stand(tmp_path)


# -- what comes ------------------------------------------------------------------------------------------------------


def test_points_become_signals_in_si_with_the_time_at_which_they_came(stand):
    stand.plc.points["left_height"] = 12.5
    stand.open()
    stand.wait(50 * ms)
    time, _, value = next(one for one in stand.heard if one[1] == "left.height")
    assert value == pytest.approx(-12.5 * mm)
    assert time % 50_000_000 == 0
    assert STATES[int(stand.last("rig.state"))] == "ACTIVE"


def test_all_transports_hear_that_set_points_go_out(stand):
    stand.open()
    stand.cycle()
    assert stand.plc.streams == stand.bus.streams == [], "nothing was given yet"
    stand.cycle(vertical_left__force_setpoint=1 * kN)
    assert [points for _, points in stand.bus.streams] == [{"Left": -1.0}]
    assert [points for _, points in stand.plc.streams] == [{}], "its sign of life hangs on it"


def test_a_value_of_two_transports_is_new_when_the_last_of_its_points_came(stand):
    stand.plc.points["f1"], stand.bus.points["F2"] = 3.0, 4.0
    stand.open()
    stand.heard.clear()
    stand.wait(0.5)
    forces = [(time, value) for time, name, value in stand.heard if name == "lateral.force"]
    assert [value for _, value in forces] == pytest.approx([7 * kN] * 10)
    assert np.diff([time for time, _ in forces]) == pytest.approx([50_000_000] * 9)


@pytest.mark.parametrize("number", [math.inf, -math.inf])
def test_what_is_infinite_is_none(stand, number):
    """An infinite pressure would be above every target."""
    stand.plc.points["left_height"] = stand.plc.points["slow_pressure"] = number
    stand.open()
    stand.wait(0.1)
    assert math.isnan(stand.last("left.height"))
    assert math.isnan(stand.wiring.read(["supply.pressure"])["supply.pressure"])


def test_a_value_one_of_whose_points_is_stale_is_none(stand):
    stand.open()
    stand.wait(0.1)
    stand.bus.silent = True  # F2 waits, with news, for f1
    stand.plc.tell("state")
    stand.bus.silent = False
    stand.bus.tell("F2")
    stand.bus.silent = stand.plc.silent = True
    stand.wait(1.0)
    stand.plc.silent = False
    stand.plc.tell("f1")
    assert math.isnan(stand.last("lateral.force"))


def test_freshness_is_that_of_the_slowest_point_and_0_for_what_is_asked(stand):
    fresh = {
        signal.name: int(limit) for signal, limit in zip(TABLE.signals, stand.wiring.freshness, strict=True)
    }
    assert fresh["left.height"] == fresh["lateral.force"] == 150_000_000
    assert fresh["load_cell.1"] == 30_000_000
    assert fresh["supply.pressure"] == fresh["interlock.estop"] == fresh["right.height"] == 0


def test_what_does_not_come_by_itself_is_read_when_asked(stand):
    stand.plc.points |= {"slow_pressure": 8.0, "estop": 0, "mode_active": 6}
    stand.open()
    told = stand.wiring.read(
        ["supply.pressure", "interlock.estop", "air.left_mode", "air.dpv", "vertical.control"]
    )
    assert told == {
        "supply.pressure": 8 * bar, "interlock.estop": 1, "air.left_mode": 2, "air.dpv": 1, "vertical.control": 1
    }  # fmt: skip
    assert math.isnan(stand.wiring.read(["air.right_mode"])["air.right_mode"])  # never written, never told
    assert stand.wiring.capabilities.notes == {
        "settings": "taken to be what was last written: vertical.control, air.right_mode"
    }


def test_an_absent_signal_is_refused_with_rig_name_and_reason(stand):
    stand.open()
    for ask in (
        lambda: stand.wiring.read(["left.auxiliary_temperature"]),
        lambda: stand.wiring.write({"air.right_target": 1 * bar}),
        lambda: stand.wiring.act("action.power_on"),
    ):
        with pytest.raises(
            NotAvailable, match=r"hall has no .*: (no thermometer|the wiring does not mention it)"
        ):
            ask()


def test_a_function_of_the_users_own_that_fails_ends_the_run_in_words(stand):
    stand.bus.points["C1"] = 4.0
    stand.open()
    assert stand.last("load_cell.1") == 250.0
    stand.bus.points["C1"] = 0.0
    stand.wait(0.1)
    assert isinstance(stand.wiring.failure, Misuse)
    assert "own.py: ZeroDivisionError" in str(stand.wiring.failure)


# -- coming and going ------------------------------------------------------------------------------------------------


def test_nobody_there(stand):
    stand.bus.refusing = True
    with pytest.raises(LinkLost, match="nobody answers"):
        stand.open()
    assert stand.plc.connections == 0  # what was opened is closed again


def test_a_silent_rig_is_told_in_bounded_time(stand):
    stand.bus.silent = True
    with pytest.raises(LinkLost, match="hall is silent: nothing came on transport bus within 1 s"):
        stand.open(within=1 * s)
    assert stand.clock.now() <= 1.1e9


def test_another_rig_than_the_one_described(stand):
    stand.plc.points["device"] = 12
    with pytest.raises(MapMismatch, match=r"plc\.device reads 12, and identity in hall\.toml says 4711"):
        stand.open()


def test_a_rig_that_tells_who_it_is_in_its_turn(stand):
    """On a bus nothing can be asked: what a wiring wants to know first may come last."""
    stand.plc.points["device"] = math.nan
    ticks = iter(range(100))

    def tell():
        if next(ticks) == 5:
            stand.plc.points["device"] = 4711

    stand.clock.every(20_000_000, tell)
    stand.open()
    assert stand.clock.now() < 1e9


def test_words_on_parting_that_do_not_fit_keep_no_connection_open(tmp_path):
    stand = Stand(tmp_path, TEXT + '[sequences]\nclose = [{ "plc.command" = 70000 }]\n').open()

    def refuse(points):
        raise ValueError("plc.command = 70000 does not fit")

    stand.plc.write = refuse
    stand.wiring.close()
    assert stand.plc.connections == stand.bus.connections == 0


def test_who_only_listens_says_nothing(tmp_path):
    stand = Stand(
        tmp_path, TEXT + '[sequences]\nopen = [{ "plc.command" = 1 }]\nclose = [{ "plc.command" = 2 }]\n'
    )
    for description, words in ((stand.description, [1, 2]), (listening(stand.description), [])):
        stand.plc.writes.clear()
        wiring = DescribedWiring("hall", description, {"plc": stand.plc, "bus": stand.bus})
        wiring.open(stand.clock, lambda *heard: None, stand.lost.append, within=1 * s)
        wiring.close()
        assert [one["command"] for one in stand.plc.writes] == words


def test_nothing_comes_after_close_and_a_loss_is_told_once(stand):
    stand.open()
    stand.plc.lose("cable out")
    stand.bus.lose("cable out too")
    assert stand.lost == ["plc: cable out"]
    stand.wiring.close()
    stand.wiring.close()
    stand.heard.clear()
    stand.wait(1.0)
    stand.cycle()
    assert not stand.heard


def test_points_that_a_transport_does_not_have(tmp_path):
    with pytest.raises(
        WiringError, match=r"signals\.\"left\.height\"\.from = 'plc\.hight': there is no point 'hight'"
    ):
        Stand(tmp_path, TEXT.replace("plc.left_height", "plc.hight"))


def test_a_state_that_has_to_be_asked_for(stand):
    stand.plc.asked.add("state")
    with pytest.raises(WiringError, match=r"\"rig\.state\"\.from = plc\.state is read only when asked"):
        DescribedWiring("hall", stand.description, {"plc": stand.plc, "bus": stand.bus})


def test_points_that_cannot_be_written(tmp_path, stand):
    stand.plc.locked = {"mode"}
    with pytest.raises(WiringError, match=r"\"air\.left_mode\"\.to = 'plc\.mode': mode can only be read"):
        DescribedWiring("hall", stand.description, {"plc": stand.plc, "bus": stand.bus})


# -- what goes -------------------------------------------------------------------------------------------------------


def test_setpoints_are_streamed_in_the_rigs_numbers(stand):
    stand.open()
    assert stand.cycle(vertical_left__force_setpoint=20 * kN, lateral__displacement_setpoint=3 * mm) == [
        {"Left": pytest.approx(-20.0), "lateral": pytest.approx(3.0)}
    ]


def test_a_set_point_that_the_rigs_numbers_cannot_be_is_told_to_the_plan(stand):
    def refuse(points, time):
        raise ValueError("Set.Left = 40 is more than 10")

    stand.open()
    stand.bus.stream = refuse
    assert stand.cycle(vertical_left__force_setpoint=40 * kN, lateral__displacement_setpoint=3 * mm) == [
        {"lateral": pytest.approx(3.0)}
    ]
    assert str(stand.wiring.failure) == "set-points cannot be sent to hall: Set.Left = 40 is more than 10"


def test_settings_go_out_together_and_are_awaited(stand):
    stand.open()
    stand.wiring.write({"air.left_mode": 2, "air.left_target": 5 * bar, "air.dpv": 1})
    assert stand.plc.writes == [{"mode": 5, "target": pytest.approx(5.0)}]
    assert stand.wiring.read(["air.left_target"])["air.left_target"] == pytest.approx(5 * bar)


def test_a_setting_that_is_never_acknowledged_is_refused_and_taken_back(stand):
    stand.open()
    stand.deaf = True
    with pytest.raises(
        Refused,
        match=r"hall never acknowledged air\.left_mode = fill: plc\.mode_active still says hold after 1 s",
    ):
        stand.wiring.write({"air.left_mode": 2, "air.left_target": 5 * bar})
    assert stand.plc.points["mode"] == 0


def test_a_mode_must_not_change_under_a_program(stand):
    stand.open()
    setpoints = {"vertical_left__force_setpoint": 20 * kN, "vertical_right__force_setpoint": 20 * kN}
    stand.cycle(5, **setpoints)
    stand.wiring.write(
        {"generator.frequency": 1.0, "generator.cycles": 9, "generator.force_amplitude": 2 * kN}
    )
    stand.wiring.act("action.program_run")
    stand.wiring.write({"vertical.control": 1})  # as it is
    with pytest.raises(Refused, match=r"vertical\.control must not change while a program runs"):
        stand.wiring.write({"vertical.control": 2})
    crest = [-one["Left"] for one in stand.cycle(100, **setpoints)]
    assert [min(crest), max(crest)] == pytest.approx([18, 22], abs=0.1)
    assert stand.last("rig.program") == 1
    stand.plc.points["state"] = 2  # HOLD
    stand.wait(0.1)
    assert stand.cycle(2, **setpoints)[-1]["Left"] == pytest.approx(-20)
    assert stand.last("rig.program") == 3


def test_what_cannot_be_taken_back_hides_no_refusal(stand):
    stand.open()
    stand.deaf = True
    write = stand.plc.write

    def once(points):
        if stand.plc.writes:
            raise ValueError("mode = 0 does not fit")
        write(points)

    stand.plc.write = once
    with pytest.raises(Refused, match="hall never acknowledged"):
        stand.wiring.write({"air.left_mode": 2})


def test_a_number_that_a_rig_rounds_is_acknowledged(stand):
    stand.open()
    stand.deaf = True
    stand.plc.react = lambda point, number: stand.plc.points.update({f"{point}_active": round(number, 2)})
    stand.wiring.write({"air.left_target": 5.004 * bar})


def test_a_choice_that_the_rig_does_not_have(stand):
    stand.open()
    with pytest.raises(NotAvailable, match=r"hall has no air\.left_mode = level: its wiring gives"):
        stand.wiring.write({"air.left_target": 5 * bar, "air.left_mode": 1})
    with pytest.raises(
        NotAvailable, match=r"hall has no lateral\.control = force: it is always displacement"
    ):
        stand.wiring.write({"lateral.control": 1})
    assert stand.plc.writes == []  # all or none


def test_a_setting_without_a_way_back_is_remembered(stand):
    stand.open()
    stand.wiring.write({"air.right_mode": 2})
    assert stand.wiring.read(["air.right_mode"])["air.right_mode"] == 2


def test_actions_and_points_of_the_rigs_own(stand):
    stand.open()
    stand.wiring.act("action.power_off")
    stand.wiring.say({"plc.command": 3, "bus.Left": 1, "plc.mode": 2})
    assert stand.plc.writes == [{"command": 7}, {"command": 0}, {"command": 3, "mode": 2}]
    assert stand.bus.writes == [{"Left": 1}]


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 9.0))
def test_what_is_set_is_what_is_in_force(tmp_path_factory, pressure):
    stand = Stand(tmp_path_factory.mktemp("rig")).open()
    stand.wiring.write({"air.left_target": pressure * bar})
    assert stand.wiring.read(["air.left_target"])["air.left_target"] == pytest.approx(
        pressure * bar, abs=1e-3
    )


# -- set-points that are not taken ---------------------------------------------------------------------------------


def test_set_points_that_an_active_rig_goes_on_refusing_are_a_failure_that_is_told(stand):
    stand.plc.points["state"] = 2
    stand.open()
    stand.wait(100 * ms)
    stand.plc.refusal = Refusal(stand.clock.now(), Refused("writing lateral was refused: because", 4))
    stand.cycle(50, lateral__displacement_setpoint=1 * mm)
    assert stand.wiring.failure is None, "in HOLD it may refuse them: the way up goes on"
    stand.plc.points["state"] = 3
    stand.cycle(10, lateral__displacement_setpoint=1 * mm)
    assert stand.wiring.failure is None, "some may be lost on the way into a state"
    stand.cycle(10, lateral__displacement_setpoint=1 * mm)
    assert isinstance(stand.wiring.failure, Refused)
    assert str(stand.wiring.failure) == "hall refuses set-points on plc: writing lateral was refused: because"


def test_what_transports_notice_is_told_by_transport(stand):
    stand.open()
    stand.plc.remarks = lambda: [Remark("3 of 7 requests got no answer", True)]
    assert stand.wiring.remarks() == {"plc": [Remark("3 of 7 requests got no answer", True)]}
