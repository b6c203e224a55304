"""Two tanks, one above the other, for pythonfmu (FMI 2.0): a pump fills the upper one; its overflow is off."""

from math import sqrt

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

G = 9.81
SMOOTH = 1e-3
PARTS = 4


def out_of(area, level):
    """Flow through a hole, smooth where the level is 0."""
    level = max(level, 0.0)
    return area * sqrt(2.0 * G) * level / sqrt(level + SMOOTH)


class TwoTanks(Fmi2Slave):
    author, description = "tests", "two tanks, one above the other"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.flow = 0.0
        self.upper_area, self.lower_area = 0.05, 0.08
        self.upper_hole, self.lower_hole = 2.0e-4, 2.2e-4
        self.overflow, self.edge = 0.0, 0.4
        self.seep = 0.0
        self.upper_start, self.lower_start = 0.2, 0.2
        self.upper = self.lower = 0.2
        self.drained = False
        self.register_variable(Real("flow", causality=Fmi2Causality.input))
        for name in (
            *("upper_area", "lower_area", "upper_hole", "lower_hole"),
            *("overflow", "edge", "seep", "upper_start", "lower_start"),
        ):
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
            )
        self.register_variable(
            Boolean("drained", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        )
        self.register_variable(Real("upper", causality=Fmi2Causality.output))
        self.register_variable(Real("lower", causality=Fmi2Causality.output))

    def exit_initialization_mode(self):
        self.upper, self.lower = self.upper_start, self.lower_start

    def rates(self, upper, lower):
        down = out_of(self.upper_hole, upper)
        # It runs over the edge into the gutter, and not into the lower tank.
        over = self.overflow * max(upper - self.edge, 0.0) ** 1.5
        away = out_of(self.lower_hole, lower) + self.seep * lower
        return (self.flow - down - over) / self.upper_area, (down - away) / self.lower_area

    def do_step(self, current_time, step_size):
        h = step_size / PARTS
        for _ in range(PARTS):
            a = self.rates(self.upper, self.lower)
            b = self.rates(self.upper + 0.5 * h * a[0], self.lower + 0.5 * h * a[1])
            self.upper += h * b[0]
            self.lower += h * b[1]
        return True
