"""An isothermal air spring on a stop, for pythonfmu3 (FMI 3.0): Python inside of an FMU behind the wires."""

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability, Unit

AIR, WARMTH, AROUND = 287.0, 293.0, 101_325.0


class PlainSpring(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.register_units(
            [
                Unit(name="m", m=1),
                Unit(name="m/s", m=1, s=-1),
                Unit(name="kg/s", kg=1, s=-1),
                Unit(name="N", kg=1, m=1, s=-2),
                Unit(name="Pa", kg=1, m=-1, s=-2),
            ]
        )
        self.time = 0.0
        self.z, self.v, self.air, self.mass = 0.0, 0.0, 0.0, None
        varying = Fmi3Variability.continuous
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=varying))
        for name, unit in {"z": "m", "v": "m/s", "air": "kg/s"}.items():
            self.register_variable(Float64(name, causality=Fmi3Causality.input, unit=unit))
        outputs = {"F": ("N", self.force), "p": ("Pa", self.pressure)}
        for name, (unit, getter) in outputs.items():
            self.register_variable(Float64(name, causality=Fmi3Causality.output, unit=unit, getter=getter))

    def volume(self):
        return 0.055 + 0.26 * self.z

    def pressure(self):
        if self.mass is None:  # no air but that of the atmosphere, wherever it begins
            self.mass = AROUND * self.volume() / (AIR * WARMTH)
        return self.mass * AIR * WARMTH / self.volume()

    def force(self):
        stop = max(-0.045 - self.z, 0.0)
        return (self.pressure() - AROUND) * 0.26 - 3e4 * self.z + 8e6 * stop - 6e3 * self.v

    def do_step(self, current_time, step_size):
        self.pressure()
        self.mass = max(self.mass + step_size * self.air, 0.03)
        return True
