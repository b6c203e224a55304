"""The groups of sensors: one row each, with all properties of the sensors of that group."""

from dataclasses import KW_ONLY, dataclass
from enum import StrEnum

from bench_protocol.units import UNITS, K, N, bar, kN, mbar, mm, mrad, ms, rad
from bench_protocol.words import PROVENANCES

Ends = tuple[float, float]  #: lower and upper end (SI)


@dataclass(frozen=True, slots=True)
class SensorRow:
    """The common properties of all sensors of a group (SI); properties without a default must be given for each group.

    The simulated sensors use these values. They also replace values that a file of instruments lacks.
    """

    name: str  #: of the group, in parameter files
    _: KW_ONLY
    panel: str  #: title of its panel in a report
    unit: str  #: display unit
    carried: Ends  #: range on the wires
    step: float  #: resolution on the wires
    at_rest: Ends  #: reading at rest, disarmed and without air
    instrument: str  #: name of the instrument of the virtual bench
    type: str  #: of the instrument, in words
    reads: Ends  #: range of the instrument
    accuracy: float  #: half-width of its offset
    gain: float  #: half-width of its relative error after a calibration; 0 if it is part of the accuracy
    lag: float  #: time constant, s
    resolution: float
    noise: float  #: standard deviation of one sample
    bias_max: float  #: the largest error that a parameter file may give
    source: str  #: of accuracy and lag
    noise_source: str
    noise_provenance: str = "assumed"

    def __post_init__(self) -> None:
        for key in ("panel", "instrument", "type", "source", "noise_source"):
            self._require(bool(getattr(self, key)), key, "a text that is not empty")
        self._require(self.unit in UNITS, "unit", f"one of {', '.join(UNITS)}")
        self._require(
            self.noise_provenance in PROVENANCES, "noise_provenance", f"one of {', '.join(PROVENANCES)}"
        )
        for key in ("carried", "at_rest", "reads"):
            low, high = getattr(self, key)
            self._require(low < high, key, "the lower end, then the upper one (SI)")
        inside = self.carried[0] <= self.at_rest[0] and self.at_rest[1] <= self.carried[1]
        self._require(inside, "at_rest", f"inside carried = {self.carried} (SI)")
        for key in ("step", "bias_max"):
            self._require(getattr(self, key) > 0.0, key, "positive (SI)")
        for key in ("accuracy", "resolution", "noise"):
            self._require(0.0 < getattr(self, key) <= self.bias_max, key, "positive, up to bias_max (SI)")
        for key in ("gain", "lag"):
            self._require(getattr(self, key) >= 0.0, key, "0 or more (SI)")

    def _require(self, fits: bool, key: str, right: str) -> None:
        if not fits:
            raise ValueError(
                f"{self.name}.{key} = {getattr(self, key)!r} in the table of sensor groups must be {right}"
            )

    @property
    def si(self) -> str:
        """The SI unit of its readings."""
        return UNITS[self.unit].si


class Group(StrEnum):
    """The groups of sensors, each with its name in parameter files and its `SensorRow`."""

    row: SensorRow

    def __new__(cls, row: SensorRow) -> "Group":
        """Make the member of a row; its value is the name of the group."""
        one = str.__new__(cls, row.name)
        one._value_ = row.name
        one.row = row
        return one

    HEIGHT = SensorRow(
        "height",
        panel="Spring heights",
        unit="mm",
        carried=(-300 * mm, 300 * mm),
        step=0.01 * mm,
        at_rest=(-150 * mm, 150 * mm),
        instrument="laser",
        type="triangulation laser, ± 150 mm",
        reads=(-150 * mm, 150 * mm),
        accuracy=0.05 * mm,
        gain=0.001,
        lag=2 * ms,
        resolution=0.005 * mm,
        noise=0.01 * mm,
        bias_max=100 * mm,
        source="triangulation laser ± 0.05 mm, 2 ms",
        noise_source="triangulation laser",
    )
    PRESSURE = SensorRow(
        "pressure",
        panel="Spring pressures (gauge)",
        unit="bar",
        carried=(-1 * bar, 15 * bar),
        step=0.5 * mbar,
        at_rest=(-100 * mbar, 200 * mbar),
        instrument="pressure_transducer",
        type="pressure transducer, 0 to 10 bar gauge",
        reads=(-0.125 * bar, 10.3 * bar),
        accuracy=0.025 * bar,
        gain=0.001,
        lag=5 * ms,
        resolution=0.0002 * bar,
        noise=0.002 * bar,
        bias_max=5 * bar,
        source="0 to 10 bar gauge, 0.25 % of full scale; ends as in NAMUR NE 43",
        noise_source="2.2 to 2.4 mbar on a real bench (Zillen 2021)",
        noise_provenance="measured",
    )
    SUPPLY_PRESSURE = SensorRow(
        "supply_pressure",
        panel="Supply (gauge)",
        unit="bar",
        carried=(-1 * bar, 15 * bar),
        step=0.5 * mbar,
        at_rest=(-100 * mbar, 12 * bar),
        instrument="supply_transducer",
        type="pressure transducer, 0 to 16 bar gauge",
        reads=(-0.2 * bar, 16.4 * bar),
        accuracy=0.04 * bar,
        gain=0.001,
        lag=20 * ms,
        resolution=0.0005 * bar,
        noise=0.003 * bar,
        bias_max=5 * bar,
        source="0 to 16 bar gauge, 0.25 % of full scale",
        noise_source="as the others, scaled to its range",
    )
    TEMPERATURE = SensorRow(
        "temperature",
        panel="Gas temperatures",
        unit="K",
        carried=(200 * K, 400 * K),
        step=0.05 * K,
        at_rest=(268 * K, 318 * K),
        instrument="thermometer",
        type="thin-film Pt100 in the gas",
        reads=(223.15 * K, 473.15 * K),
        accuracy=0.1 * K,
        gain=0,
        lag=1000 * ms,
        resolution=0.01 * K,
        noise=0.01 * K,
        bias_max=50 * K,
        source="thin-film Pt100, 1 s lag, 0.1 K",
        noise_source="Pt100",
    )
    VERTICAL_FORCE = SensorRow(
        "vertical_force",
        panel="Vertical actuator forces",
        unit="kN",
        carried=(-200 * kN, 200 * kN),
        step=10 * N,
        at_rest=(-2 * kN, 2 * kN),
        instrument="vertical_force_transducer",
        type="force transducer of a vertical actuator, 200 kN",
        reads=(-205000 * N, 205000 * N),
        accuracy=200 * N,
        gain=0.001,
        lag=1 * ms,
        resolution=8 * N,
        noise=20 * N,
        bias_max=50000 * N,
        source="200 kN, 0.1 % of full scale",
        noise_source="strain gauge amplifier",
    )
    LATERAL_FORCE = SensorRow(
        "lateral_force",
        panel="Lateral actuator force",
        unit="kN",
        carried=(-60 * kN, 60 * kN),
        step=2 * N,
        at_rest=(-1 * kN, 1 * kN),
        instrument="lateral_force_transducer",
        type="force transducer of the lateral actuator, 50 kN",
        reads=(-51000 * N, 51000 * N),
        accuracy=50 * N,
        gain=0.001,
        lag=1 * ms,
        resolution=2 * N,
        noise=20 * N,
        bias_max=10000 * N,
        source="50 kN, 0.1 % of full scale",
        noise_source="strain gauge amplifier",
    )
    DISPLACEMENT = SensorRow(
        "displacement",
        panel="Actuator displacements",
        unit="mm",
        carried=(-300 * mm, 300 * mm),
        step=0.01 * mm,
        at_rest=(-150 * mm, 150 * mm),
        instrument="piston_transducer",
        type="magnetostrictive transducer in the piston",
        reads=(-260 * mm, 260 * mm),
        accuracy=0.05 * mm,
        gain=0.0005,
        lag=1 * ms,
        resolution=0.005 * mm,
        noise=0.01 * mm,
        bias_max=100 * mm,
        source="magnetostrictive transducer in the piston",
        noise_source="magnetostrictive transducer",
    )
    VERTICAL_LOAD_CELL = SensorRow(
        "vertical_load_cell",
        panel="Vertical load cells",
        unit="kN",
        carried=(-200 * kN, 200 * kN),
        step=25 * N,
        at_rest=(-1 * kN, 10 * kN),
        instrument="vertical_load_cell",
        type="load cell under the platform, upright, 200 kN",
        reads=(-205000 * N, 205000 * N),
        accuracy=200 * N,
        gain=0.001,
        lag=1 * ms,
        resolution=8 * N,
        noise=20 * N,
        bias_max=50000 * N,
        source="200 kN, 0.1 % of full scale",
        noise_source="strain gauge amplifier",
    )
    LATERAL_LOAD_CELL = SensorRow(
        "lateral_load_cell",
        panel="Lateral load cells",
        unit="kN",
        carried=(-60 * kN, 60 * kN),
        step=2 * N,
        at_rest=(-1 * kN, 1 * kN),
        instrument="lateral_load_cell",
        type="load cell under the platform, across, 50 kN",
        reads=(-51000 * N, 51000 * N),
        accuracy=50 * N,
        gain=0.001,
        lag=1 * ms,
        resolution=2 * N,
        noise=20 * N,
        bias_max=10000 * N,
        source="50 kN, 0.1 % of full scale",
        noise_source="strain gauge amplifier",
    )
    ACCELERATION = SensorRow(
        "acceleration",
        panel="Lateral acceleration",
        unit="m/s2",
        carried=(-30.0, 30.0),
        step=0.001,
        at_rest=(-0.5, 0.5),
        instrument="accelerometer",
        type="capacitive accelerometer, ± 5 g",
        reads=(-50.0, 50.0),
        accuracy=0.02,
        gain=0.005,
        lag=1 * ms,
        resolution=0.002,
        noise=0.01,
        bias_max=10.0,
        source="capacitive accelerometer, ± 5 g",
        noise_source="capacitive accelerometer",
    )
    PLATFORM_DISPLACEMENT = SensorRow(
        "platform_displacement",
        panel="Platform",
        unit="mm",
        carried=(-150 * mm, 150 * mm),
        step=0.01 * mm,
        at_rest=(-20 * mm, 20 * mm),
        instrument="platform_transducer",
        type="magnetostrictive transducer of the platform",
        reads=(-200 * mm, 200 * mm),
        accuracy=0.02 * mm,
        gain=0.0005,
        lag=1 * ms,
        resolution=0.005 * mm,
        noise=0.005 * mm,
        bias_max=100 * mm,
        source="magnetostrictive transducer",
        noise_source="magnetostrictive transducer",
    )
    PLATFORM_ROLL = SensorRow(
        "platform_roll",
        panel="Platform roll",
        unit="mrad",
        carried=(-0.3 * rad, 0.3 * rad),
        step=0.01 * mrad,
        at_rest=(-20 * mrad, 20 * mrad),
        instrument="platform_roll",
        type="two transducers of the platform",
        reads=(-200 * mrad, 200 * mrad),
        accuracy=0.05 * mrad,
        gain=0.0005,
        lag=1 * ms,
        resolution=0.005 * mrad,
        noise=0.005 * mrad,
        bias_max=100 * mrad,
        source="from two transducers",
        noise_source="from two transducers",
    )
