"""The pictures of the gallery in order: each with its caption, its commands, and the function that draws it."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from astb_studies.gallery.certainty import certainty
from astb_studies.gallery.found import before_and_after
from astb_studies.gallery.measured import gust, leveling, stiffness
from astb_studies.gallery.mutations import matrix
from astb_studies.gallery.safety import time_to_safe
from astb_studies.gallery.sketch import sketch
from astb_studies.places import DOCS

GALLERY: Final = DOCS / "gallery"
#: Where the commands put their runs, as a reader types them.
RUNS: Final = "runs/gallery"


@dataclass(frozen=True)
class Recipe:
    """One picture; ``draw`` gets the folder in which the commands left their runs, and the picture's path."""

    file: str
    title: str
    sees: str
    draw: Callable[[Path, Path], None]
    commands: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return Path(self.file).stem

    @property
    def made_by(self) -> tuple[str, ...]:
        """The commands that reproduce the picture: the runs, then the drawing."""
        return (*self.commands, f"make gallery ARGS={self.name}")


def _paper(runs: Path, path: Path) -> None:
    shutil.copy(runs / "paper" / path.name, path)


def _run(plan: str) -> str:
    return f"astb run {plan} --virtual --seed 1 --out {RUNS}"


RECIPES: Final = (
    Recipe(
        "rig.svg",
        "Bench and interfaces",
        "Two air springs carry a bolster (a cross beam) over a moving platform. CAN transmits measurements and "
        "set-points, Modbus/TCP connects the PLC. Plans use only these interfaces, so they also run on a real rig.",
        sketch,
    ),
    Recipe(
        "stiffness.svg",
        "Stiffness and loss of a spring",
        "Loops of force over displacement at three amplitudes; measured stiffness K' and loss K'' over frequency, with "
        "their limits. At the peak of K'', the air flow through the orifice has the largest loss.",
        stiffness,
        (_run("dynamic_stiffness"),),
    ),
    Recipe(
        "leveling.svg",
        "Leveling from the empty to the full car and back",
        "The load changes from AW0 (empty car) to AW3 (full car) and back. The leveling valves fill and exhaust both "
        "springs, at constant height. The shaded strips are the times that the specimen file allows.",
        leveling,
        (_run("leveling"),),
    ),
    Recipe(
        "gust.svg",
        "A gust of side wind, and the differential pressure valve",
        "Left: a gust pushes and rolls the bolster. The pressures of the springs differ, but the differential pressure "
        "valve between them stays closed, as required. Right: another plan rolls the bolster until the valve opens.",
        gust,
        (_run("crosswind_gust differential_pressure_valve"),),
    ),
    Recipe(
        "figure-08.svg",
        "A figure of the paper, measured on the bench",
        "Lateral stiffness and damping. Points: measurements on the simulated rig with sensor errors. Solid lines: the "
        "model with parameters that were identified on this rig. Dashed lines: the equations of the paper.",
        _paper,
        (f"astb paper --out {RUNS}/paper",),
    ),
    Recipe(
        "figure-11.svg",
        "A second figure: stiffness and damping over frequency",
        "With and without a pipe between bellows and auxiliary chamber. Points: measurements. Solid lines: the model. "
        "Dashed lines: the paper.",
        _paper,
        (f"astb paper --out {RUNS}/paper",),
    ),
    Recipe(
        "safe.svg",
        "Time to the safe position",
        "The program that commands the rig is lost in nine ways, each at the same random instants. Each point is the "
        "time until the springs have no air and the actuators no force. The red mark is the limit.",
        time_to_safe,
    ),
    Recipe(
        "matrix.svg",
        "Faults that the plans detect",
        "Realistic faults, each alone on a simulated rig, under all plans. Blue: the intended check detects the fault. "
        "Grey: not detected (darker: nearer to a limit). Empty: not tried.",
        matrix,
    ),
    Recipe(
        "found.svg",
        "A hidden leak",
        "A model without a leak does not fit the pressure of a leaking bellows. The diagnosis finds the leak. The "
        "model with the leak fits within the noise.",
        before_and_after,
        (
            f"astb run large_sines --virtual --seed 7 --effect leak.left=0.2mm2 --out {RUNS}",
            f"astb diagnose {RUNS}/large_sines --effects leak,heat,friction,maxwell --out {RUNS}/found",
        ),
    ),
    Recipe(
        "certainty.svg",
        "Verdict and probability of conformity",
        "A value passes if the probability of conformity is at least 97.5 %. In the guard bands next to the "
        "limits it is marginal. Below: values of a run with their expanded uncertainties.",
        certainty,
        (_run("dynamic_stiffness"),),
    ),
)
