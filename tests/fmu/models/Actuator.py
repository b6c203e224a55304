"""A pneumatic cylinder with a chamber of air, for pythonfmu3 (FMI 3.0): its leak and its seal's friction are off."""

from math import sqrt, tanh

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability, Unit

AIR, AROUND, KAPPA = 287.05, 101_325.0, 1.4
PARTS = 4


class Actuator(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.register_units(
            [
                Unit(name="m", m=1),
                Unit(name="mm", factor=1e-3, m=1),
                Unit(name="cm2", factor=1e-4, m=2),
                Unit(name="bar", factor=1e5, kg=1, m=-1, s=-2),
                Unit(name="N", kg=1, m=1, s=-2),
                Unit(name="m/s", m=1, s=-1),
                Unit(name="mm2", factor=1e-6, m=2),
                Unit(name="s", s=1),
            ]
        )
        self.time = 0.0
        self.position, self.speed = 0.0, 0.0
        self.area, self.dead, self.filled = 20.0, 60.0, 4.0
        self.leak, self.seal = 0.0, 0.0
        self.warmth = 0.4
        self.mass = self.temperature = None
        varying = Fmi3Variability.continuous
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=varying))
        self.register_variable(Float64("position", causality=Fmi3Causality.input, unit="m"))
        self.register_variable(Float64("speed", causality=Fmi3Causality.input, unit="m/s"))
        for name, unit in {
            "area": "cm2",
            "dead": "mm",
            "filled": "bar",
            "leak": "mm2",
            "seal": "N",
            "warmth": "s",
        }.items():
            one = Float64(
                name, causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable, unit=unit
            )
            self.register_variable(one)
        for name, unit, getter in (
            ("pressure", "bar", lambda: self.absolute() / 1e5),
            ("force", "N", self.force),
        ):
            self.register_variable(Float64(name, causality=Fmi3Causality.output, unit=unit, getter=getter))

    def volume(self):
        return 1e-4 * self.area * (1e-3 * self.dead - self.position)

    def absolute(self):
        if self.mass is None:
            return 1e5 * self.filled
        return self.mass * AIR * self.temperature / self.volume()

    def force(self):
        return 1e-4 * self.area * (self.absolute() - AROUND) + self.seal * tanh(self.speed / 0.002)

    def exit_initialization_mode(self):
        self.temperature = 293.15
        self.mass = 1e5 * self.filled * self.volume() / (AIR * self.temperature)

    def rates(self, mass, temperature, volume, widening):
        pressure = mass * AIR * temperature / volume
        out = 1e-6 * self.leak * pressure * 0.6847 / sqrt(AIR * temperature) if pressure > AROUND else 0.0
        heat = (293.15 - temperature) / self.warmth
        cooling = (KAPPA - 1.0) * temperature * (out / mass + widening / volume)
        return -out, heat - cooling

    def do_step(self, current_time, step_size):
        h = step_size / PARTS
        widening = -1e-4 * self.area * self.speed
        middle = self.volume()
        for k in range(PARTS):
            volume = middle + (k + 0.5 - 0.5 * PARTS) * h * widening
            a = self.rates(self.mass, self.temperature, volume - 0.5 * h * widening, widening)
            b = self.rates(self.mass + 0.5 * h * a[0], self.temperature + 0.5 * h * a[1], volume, widening)
            self.mass += h * b[0]
            self.temperature += h * b[1]
        return True
