"""y = gain · u; what else it does depends on ``mood``: 1 crashes, 2 hangs, 3 refuses, 4 forgets nothing, 5 is NaN."""

import os
import signal

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

EVERY = [0.0]


class Bomb(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.y, self.gain, self.mood = 0.0, 0.0, 1.0, 0.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        for name in ("gain", "mood"):
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
            )

    def do_step(self, current_time, step_size):
        EVERY[0] += 1.0
        self.y = self.gain * self.u
        if current_time > 0.145:
            if self.mood == 1.0:
                os.kill(os.getpid(), signal.SIGSEGV)
            while self.mood == 2.0:
                pass
            if self.mood == 3.0:
                return False
            if self.mood == 4.0:
                self.y += 1e-6 * EVERY[0]
            if self.mood == 5.0:
                self.y = float("nan")
        return True
