"""What stories are made of: where they start, and what a commander may do there."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from hypothesis import strategies as st

from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm
from bench_protocol.words import AIR_MODES, AXES, CONTROL_MODES, SIDES
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans.description import ours
from test_plans.loads import Load
from test_plans.specimen import ordinary
from tests.rig.bookmark import Bookmark
from tests.rig.way_down import VERTICAL, WatchedCommander

FORCE, DISPLACEMENT = CONTROL_MODES.index("force"), CONTROL_MODES.index("displacement")
LEVEL, FILL = AIR_MODES.index("level"), AIR_MODES.index("fill")


OURS = ours()
AW0, AW3 = (ordinary().load(name) for name in ("AW0", "AW3"))

# --- where stories start --------------------------------------------------------------------------------------------


def both(what: str, **values: float) -> dict[str, float]:
    return {f"{what}_{side}_{name}": value for side in SIDES for name, value in values.items()}


def go(commander: WatchedCommander, to: float, what: str = "displacement", rate: float = 0.04) -> None:
    """Move both vertical actuators to ``to`` with ``rate`` (SI, per second), and wait for their arrival."""
    place = commander.read(f"vertical_left.{what}")
    steps = max(1, round(abs(to - place) / rate * 50))
    for k in range(1, steps + 1):
        commander.cycle(
            1, **{f"{name}_{what}_setpoint": place + (to - place) * k / steps for name in VERTICAL}
        )
    commander.cycle(25)


def only_armed(commander: WatchedCommander) -> None:
    """Armed, without air."""


def on_the_valves(commander: WatchedCommander, load: Load) -> None:
    """Both springs carry the load on their leveling valves, the actuators press with constant force."""
    go(commander, 0.0)
    commander.apply(**both("air", mode=FILL, target=load.fill_pressure))
    commander.cycle(600)
    commander.cycle(2, **{f"{name}_force_setpoint": commander.read(f"{name}.force") for name in VERTICAL})
    commander.apply(vertical_control=FORCE, **both("air", mode=LEVEL))
    go(commander, load.actuator_force(OURS), "force", 20 * kN)
    commander.cycle(300)
    assert abs(commander.read("left.height")) < 15 * mm
    assert commander.read("left.bellows_pressure") > 0.9 * load.fill_pressure


def held(commander: WatchedCommander, load: Load) -> None:
    """The same, held at its height."""
    on_the_valves(commander, load)
    commander.hold_height()


def held_down(commander: WatchedCommander) -> None:
    """Springs at 3.5 bar, and actuators that hold the bolster down against them."""
    commander.apply(**both("air", mode=FILL, target=3.5 * bar))
    commander.cycle(1000)


def hanging(commander: WatchedCommander) -> None:
    """The bolster hangs on the actuators, 60 mm over design height."""
    go(commander, 60 * mm)


STARTS: dict[str, Callable[[WatchedCommander], None]] = {
    "armed": only_armed,
    "AW0 on the valves": lambda commander: on_the_valves(commander, AW0),
    "AW3 on the valves": lambda commander: on_the_valves(commander, AW3),
    "AW3 held": lambda commander: held(commander, AW3),
    "held down": held_down,
    "hanging": hanging,
}


@cache
def prepared(start: str) -> tuple[WatchedCommander, Bookmark]:
    """Return a commander of a bench that was brought to ``start``, and a snapshot of both."""
    commander = WatchedCommander(Rig(load("astb"), seed=1))
    commander.wait(500)
    if start.startswith("AW3"):
        commander.apply(rig_nominal_preload=AW3.preload)
    commander.arm()
    commander.hold_height()
    STARTS[start](commander)
    assert commander.state == "ACTIVE"
    return commander, Bookmark(commander)


# --- what may happen ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Deed:
    """One thing that a commander does; its ``repr`` is a line of the story."""

    what: str
    values: tuple[tuple[str, float], ...] = ()
    cycles: int = 1

    def __repr__(self) -> str:
        shown = ", ".join(f"{name} = {value:g}" for name, value in self.values)
        return f"{self.what} {shown} ({self.cycles * 20} ms)".replace("  ", " ")

    def do(self, commander: WatchedCommander) -> None:
        """Do it; the bench may refuse it."""
        match self.what:
            case "apply":
                for answer in commander.stage(**dict(self.values)):
                    assert answer[0] == 0x10
                commander.coil("apply")
            case "coil":
                commander.coil(self.values[0][0])
            case "steer":
                for name, value in self.values:
                    commander.values[ROWS[name]] = value
            case "pause":
                commander.wait(20 * self.cycles)
                return
        commander.cycle(self.cycles)


ROWS = {signal.name.replace(".", "_"): row for row, signal in enumerate(TABLE.signals)}
CYCLES = st.integers(1, 60)
PRESSURES = st.sampled_from([0.3 * bar, 1.56 * bar, 3.5 * bar, 5.5 * bar, 8.5 * bar])
HEIGHTS = st.sampled_from([-110 * mm, -60 * mm, -20 * mm, 0.0, 30 * mm, 60 * mm, 110 * mm])
#: The first two pull up an empty bolster, which is fast then.
FORCES = st.sampled_from([-60 * kN, -20 * kN, 0.0, 53.5 * kN, 145 * kN, 185 * kN])
COILS = st.sampled_from(
    [
        "program_run",
        "program_stop",
        "program_add",
        "program_car",
        "air_low",
        "air_high",
        "reset",
        "disable",
        "power_on",
        "power_off",
    ]
)


def order(what: str, values: st.SearchStrategy[dict[str, float]], longer: int = 1) -> st.SearchStrategy[Deed]:
    return st.tuples(values, CYCLES).map(lambda drawn: Deed(what, tuple(drawn[0].items()), longer * drawn[1]))


def deed(what: str, **values: st.SearchStrategy) -> st.SearchStrategy[Deed]:
    return order(what, st.fixed_dictionaries(values))


def bits_of(given: dict[str, bool]) -> dict[str, float]:
    return {f"control_{bit}": float(on) for bit, on in given.items()}


DEEDS = st.one_of(
    *(
        deed("apply", **{f"air_{side}_mode": st.integers(0, 3), f"air_{side}_target": PRESSURES})
        for side in SIDES
    ),
    order("apply", PRESSURES.map(lambda target: both("air", mode=FILL, target=target)), 10),
    deed("apply", air_left_reservoir=st.integers(0, 1), air_right_reservoir=st.integers(0, 1)),
    deed("apply", air_dpv=st.integers(0, 1)),
    deed("apply", vertical_control=st.integers(0, 2)),
    deed("apply", lateral_control=st.integers(0, 2)),
    order("steer", HEIGHTS.map(lambda height: both("vertical", displacement_setpoint=height))),
    order("steer", FORCES.map(lambda force: both("vertical", force_setpoint=force))),
    deed("steer", lateral_displacement_setpoint=HEIGHTS),
    deed("steer", lateral_force_setpoint=st.sampled_from([-50 * kN, -20 * kN, 0.0, 20 * kN, 50 * kN])),
    deed("steer", vertical_left_force_setpoint=FORCES),
    deed("steer", vertical_left_displacement_setpoint=HEIGHTS),
    deed(
        "apply",
        generator_axis=st.integers(0, len(AXES) - 1),
        generator_amplitude=st.floats(0.0, 0.1),
        generator_force_amplitude=st.floats(0.0, 60 * kN),
        generator_frequency=st.sampled_from([0.2, 1.0, 5.0]),
        generator_cycles=st.sampled_from([1, 3, 20]),
    ),
    # A car that falls over, one that stands, or too light a one: on the track, in the wind.
    deed(
        "apply",
        **{f"car_stop_travel_{k}": st.just(k * 10 * mm) for k in range(1, 10)},
        **{f"car_stop_force_{k}": st.just(k * 3 * kN) for k in range(1, 10)},
        car_mass=st.sampled_from([500.0, 10_900.0, 1e9]),
        car_roll_gyration=st.just(1.3),
        car_centre_height=st.sampled_from([0.0, 0.67]),
        car_damper_rate=st.sampled_from([0.0, 30 * kN]),
        car_anti_roll_stiffness=st.sampled_from([0.0, 940 * kN]),
        car_track_frequency=st.sampled_from([0.2, 1.2, 3.0]),
        car_track_waves=st.sampled_from([1, 20]),
        car_track_lateral=st.floats(0.0, 0.02),
        car_track_vertical=st.floats(0.0, 0.02),
        car_track_roll=st.floats(0.0, 0.01),
        car_piston_lead=st.sampled_from([0.0, 0.0145, 0.2]),
        vertical_control=st.just(CONTROL_MODES.index("displacement")),
        lateral_control=st.just(CONTROL_MODES.index("displacement")),
    ),
    deed("steer", car_wind_setpoint=st.sampled_from([-60 * kN, 0.0, 10 * kN, 60 * kN])),
    order("coil", COILS.map(lambda name: {name: 1.0})),
    order("steer", st.fixed_dictionaries({"hold": st.booleans(), "active": st.booleans()}).map(bits_of)),
    order("steer", st.fixed_dictionaries({"enable": st.booleans(), "reset": st.booleans()}).map(bits_of)),
    st.integers(1, 12).map(lambda cycles: Deed("pause", (), cycles)),
)
