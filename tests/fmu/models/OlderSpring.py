"""An isothermal air spring on a stop, for pythonfmu (FMI 2.0): as `PlainSpring.py`, whose variables have units."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real

AIR, WARMTH, AROUND = 287.0, 293.0, 101_325.0


class OlderSpring(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.z, self.v, self.air, self.mass = 0.0, 0.0, 0.0, None
        for name in ("z", "v", "air"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name, getter in {"F": self.force, "p": self.pressure}.items():
            self.register_variable(Real(name, causality=Fmi2Causality.output, getter=getter))

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
