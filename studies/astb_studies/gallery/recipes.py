"""What the gallery shows, in order: each picture, what one sees on it, the commands behind it, and what draws it."""

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
        """What a reader types to see the same: the runs, then the drawing."""
        return (*self.commands, f"make gallery ARGS={self.name}")


def _paper(runs: Path, path: Path) -> None:
    shutil.copy(runs / "paper" / path.name, path)


def _run(plan: str) -> str:
    return f"astb run {plan} --virtual --seed 1 --out {RUNS}"


RECIPES: Final = (
    Recipe(
        "rig.svg",
        "The bench and its wires",
        "Two air springs carry a bolster over a platform that moves. What is fast travels on CAN, what a PLC would do "
        "on Modbus/TCP. Plans see nothing else, so the same plan runs on steel.",
        sketch,
    ),
    Recipe(
        "stiffness.svg",
        "Stiffness and loss of a spring",
        "Loops of force over displacement at three amplitudes; K' and K'' over frequency as the plan measured them, "
        "with their limits. K'' has a peak where the air just fails to follow through the orifice.",
        stiffness,
        (_run("dynamic_stiffness"),),
    ),
    Recipe(
        "leveling.svg",
        "From the empty to the full car and back",
        "The leveling valves fill both springs from the pressure of AW0 to that of AW3 and let it out again, at held "
        "height. The shaded strips are the times that the specimen's file allows.",
        leveling,
        (_run("leveling"),),
    ),
    Recipe(
        "gust.svg",
        "A gust of side wind, and the valve that must not open",
        "Left, a gust pushes and rolls the bolster: the pressures of the springs part, and the differential pressure "
        "valve between them stays shut, as it must. Right, another plan rolls the bolster until that valve opens and "
        "closes again.",
        gust,
        (_run("crosswind_gust differential_pressure_valve"),),
    ),
    Recipe(
        "figure-08.svg",
        "The paper's figure, measured anew",
        "Lateral stiffness and damping. Points are measurements on the virtual bench with the errors of its sensors, "
        "solid lines the plant's model with parameters identified on that rig, dashed lines the paper's closed forms.",
        _paper,
        (f"astb paper --out {RUNS}/paper",),
    ),
    Recipe(
        "figure-11.svg",
        "Another one: stiffness and damping over frequency",
        "With and without a pipe between bellows and auxiliary chamber. Same signs as above: points are measured, "
        "solid lines are the plant's model, dashed lines the paper's.",
        _paper,
        (f"astb paper --out {RUNS}/paper",),
    ),
    Recipe(
        "safe.svg",
        "How long until it is safe",
        "Nine ways to lose the commander, each at the same instants, drawn by chance. A point is one cut: no air "
        "in the springs, actuators let go. The red mark is what the table of states promises.",
        time_to_safe,
    ),
    Recipe(
        "matrix.svg",
        "What the plans catch",
        "Faults that a workshop meets, each alone on an otherwise sound bench, under the plans. Blue: caught by a "
        "check that is meant for the fault. Grey: missed, the darker the nearer to a limit. Empty: not tried.",
        matrix,
    ),
    Recipe(
        "found.svg",
        "A hole that nobody told of",
        "The model of a sound spring cannot follow the pressure of a bellows that leaks. The diagnosis names the hole "
        "among its suspects; with it, the model follows within the noise.",
        before_and_after,
        (
            f"astb run large_sines --virtual --seed 7 --effect leak.left=0.2mm2 --out {RUNS}",
            f"astb diagnose {RUNS}/large_sines --effects leak,heat,friction,maxwell --out {RUNS}/found",
        ),
    ),
    Recipe(
        "certainty.svg",
        "A verdict is a probability",
        "A value passes if it conforms to its limits with 97.5 % at least. In the guard bands beside them it is "
        "marginal: inside, but not surely so. Below, values of a run with their expanded uncertainties.",
        certainty,
        (_run("dynamic_stiffness"),),
    ),
)
