"""Half a car on one bogie, for pythonfmu3 (FMI 3.0): Python inside, independent equations and integrator."""

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability

TRAVEL = [25e-3, 30e-3, 35e-3, 40e-3, 45e-3, 50e-3, 55e-3, 60e-3, 65e-3]
FORCE = [0.0, 600.0, 1760.0, 3730.0, 6870.0, 11580.0, 17170.0, 29200.0, 230000.0]
INPUTS = (
    "F_left",
    "F_right",
    "S_left",
    "S_right",
    "M_left",
    "M_right",
    "wind",
    "y_track",
    "z_track",
    "v_track",
    "w_track",
)
OUTPUTS = (
    "h_left",
    "h_right",
    "shear",
    "h_left_rate",
    "h_right_rate",
    "shear_rate",
    "a_floor",
    "a_up",
    "stop",
    "lean",
)
#: Integrated in steps of this length at most, s.
STEP = 1e-3


class RidingCar(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = 0.0
        self.mass, self.gyration, self.g = 10911.0, 1.33, 9.80665
        self.e, self.floor, self.wind_up = 0.67, 0.6, 0.4
        self.damper, self.damper_down, self.stop_down = 30e3, 1.1, 1.1
        self.bar, self.b = 940e3, 1.0
        self.state = [0.0] * 6  # y, z, roll, and their speeds
        for name in INPUTS + OUTPUTS:
            setattr(self, name, 0.0)
        varying = Fmi3Variability.continuous
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=varying))
        for name in INPUTS:
            self.register_variable(Float64(name, causality=Fmi3Causality.input))
        for name in OUTPUTS:
            self.register_variable(Float64(name, causality=Fmi3Causality.output))
        for name in ("mass", "gyration", "b"):
            self.register_variable(
                Float64(name, causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable)
            )

    def slope(self, s, since):
        y, _, roll, vy, vz, vr = s
        y_track, v_track = self.y_track + since * self.v_track, self.v_track
        damping = -self.damper * (vy - v_track + self.damper_down * vr)
        travel = y - y_track + self.stop_down * roll
        stop = 0.0
        if abs(travel) > TRAVEL[0]:
            k = next((k for k in range(1, 8) if abs(travel) < TRAVEL[k]), 8)
            part = (abs(travel) - TRAVEL[k - 1]) / (TRAVEL[k] - TRAVEL[k - 1])
            stop = FORCE[k - 1] + part * (FORCE[k] - FORCE[k - 1])
            stop = -stop if travel > 0 else stop
        shear = self.S_left + self.S_right
        moment = self.M_left + self.M_right + self.b * (self.F_left - self.F_right) + self.e * shear
        moment += self.damper_down * damping + self.stop_down * stop - self.wind_up * self.wind
        moment += (self.mass * self.g * self.e - self.bar) * roll
        ay = (self.wind + shear + damping + stop) / self.mass
        az = (self.F_left + self.F_right) / self.mass - self.g
        ar = moment / (self.mass * self.gyration**2)
        self.a_floor, self.a_up, self.stop = ay + self.floor * ar, az, stop
        return [vy, vz, vr, ay, az, ar]

    def do_step(self, current_time, step_size):
        pieces = max(1, round(step_size / STEP))
        h = step_size / pieces
        for n in range(pieces):
            s, t = self.state, n * h
            k1 = self.slope(s, t)
            k2 = self.slope([a + 0.5 * h * b for a, b in zip(s, k1, strict=True)], t + 0.5 * h)
            k3 = self.slope([a + 0.5 * h * b for a, b in zip(s, k2, strict=True)], t + 0.5 * h)
            k4 = self.slope([a + h * b for a, b in zip(s, k3, strict=True)], t + h)
            self.state = [
                a + h / 6 * (p + 2 * (q + r) + u) for a, p, q, r, u in zip(s, k1, k2, k3, k4, strict=True)
            ]
        y, z, roll, vy, vz, vr = self.state
        z -= self.z_track + step_size * self.w_track
        vz -= self.w_track
        self.h_left, self.h_right = z + self.b * roll, z - self.b * roll
        self.h_left_rate, self.h_right_rate = vz + self.b * vr, vz - self.b * vr
        self.shear = y + self.e * roll - self.y_track - step_size * self.v_track
        self.shear_rate = vy + self.e * vr - self.v_track
        self.lean = roll
        return True
