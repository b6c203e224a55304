"""The figures and tables with heading and caption, and their output as SVG and PNG."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from astb_studies.paper.figures.comfort import comfort
from astb_studies.paper.figures.figure_05 import figure_5
from astb_studies.paper.figures.figure_06 import figure_6
from astb_studies.paper.figures.figure_07 import figure_7
from astb_studies.paper.figures.figure_08 import figure_8
from astb_studies.paper.figures.figure_09 import figure_9
from astb_studies.paper.figures.figure_10 import figure_10
from astb_studies.paper.figures.figure_11 import figure_11
from astb_studies.paper.figures.sensitivity import sensitivity
from astb_studies.paper.sensitivity import SPREAD
from astb_studies.paper.study import Study
from bench_records.plots import element, plain_numbers, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure or table: name of its files, heading, caption, and the function that draws it."""

    name: str
    title: str
    caption: str
    draw: Callable[[Study], "Figure"]


#: The figures and the table in the paper's order.
SECTIONS: Final = (
    Picture(
        "figure-05",
        "Figure 5. Track excitation",
        "Equation (24) for four amplitudes (a) and three angular frequencies (b). The points are the"
        " platform of the bench in the plan <code>aw0</code>, as its own transducer reports them at 50"
        " Hz.",
        figure_5,
    ),
    Picture(
        "figure-06",
        "Figure 6. What the bench measures",
        "(a, b) First harmonic of the lateral force over that of the displacement at 0.5 Hz, half of"
        " the pair's, under five preloads around each load case, each on shims of its own. (c) Vertical"
        " damping c = K″/ω for four pairs of orifice plates; the pressure ratio is the lowest of a"
        " cycle, and the amplitude (1 to 25 mm) is what changes it. The dashed lines of (c) are equation"
        " (19), for which the ratio is a free choice."
        " Crosses in (a, b): wind and track at once, the paper's own experiment (plans"
        " <code>crosswind_and_track_…</code>, 1.2 Hz, the bolster free), with their expanded uncertainty. There the"
        " track shears the springs by 1.4 to 3 mm only, as a light bolster follows it, and a small motion is stiff by"
        " friction; the sines are of one axis, held, with a stated amplitude.",
        figure_6,
    ),
    Picture(
        "figure-07",
        "Figure 7. Identified effective area and equivalent volume",
        "Points: the chambers are shut off and the springs sheared step by step, so that the mass of gas in the"
        " bellows stays: A = F<sub>z</sub>/p, V ∝ T/p. Line: <code>astb identify</code> of a run of the plan"
        " <code>identification</code> on the first rig, the mean of both springs. It fits all parameters, loads and"
        " zeros at once. The paper's volume grows. That of a bellows cannot: it would push itself off its centre.",
        figure_7,
    ),
    Picture(
        "figure-08",
        "Figure 8. Model against experiment, and what a deviation proves",
        "(a, b, c) The plant's model with the parameters that were identified on the same rig, put"
        " to the pressures and amplitudes that the bench reached. Dotted in (c): the same with the"
        " orifice alone, as in the paper; it lies below the bench by the few per cent that the rubber"
        " adds. (d, e, f) At 1.2 Hz and 5 mm three things look alike: the rubber, 5 ms between the"
        " channels of force and displacement, and a C<sub>d</sub> that is believed 5 % too large. The"
        " frequency sweep (d) tells the lag, which grows without end, and C<sub>d</sub>, which changes"
        " its sign; the amplitude sweep (e) tells C<sub>d</sub> again; and in the force from which"
        " pressure times area is taken off (f) the orifice leaves next to nothing: what stays there is"
        " rubber if it is flat, and lag if it rises with the frequency. A single frequency proves none"
        " of them."
        " Crosses in (a, b): wind and track at once, as in figure 6; dash-dotted: the same plan on the"
        " model."
        " Points in (f): the same sweep on the bench, the pressure times the identified area taken off, each reading"
        " without the lag of its sensor.",
        figure_8,
    ),
    Picture(
        "figure-09",
        "Figure 9. Lateral displacement",
        "(a) Secant F/y on the way out, bellows shut off, friction and all; dotted what the model has"
        " without friction. (b) A motion of 1 mm at 2 Hz about each offset, both chambers joined: what"
        " the secant hides.",
        figure_9,
    ),
    Picture(
        "figure-10",
        "Figure 10. Roll angle",
        "Both springs stand 20 mm aside and are rolled to both sides, the differential pressure valve"
        " isolated (filled) and open (hollow). The secant rises for one sign of roll and falls for the"
        " other. The first harmonic of 5 mm about that place does not rise at all. Below: how far the"
        " pressures of the two sides part, and where the valve joins them."
        " Crosses: wind and track at once, the bolster free and rolled by unequal preload (its angle before the"
        " wind). They are first harmonics about a place of some 10 mm, of a motion of 1.4 to 3 mm: stiffer by friction"
        " than 5 mm about 20 mm, and as little changed by roll.",
        figure_10,
    ),
    Picture(
        "figure-11",
        "Figure 11. Frequency",
        "Amplitude 5 mm where piston speed and force allow it; laterally it becomes less beyond 10 Hz,"
        " and friction makes a spring stiffer at a smaller amplitude. The hollow points at 0.9 mm show"
        " frequency alone. “Pipe” is the connecting pipe of 1.5 m × 50 mm with a plate of 30 mm. Below"
        " 0.3 Hz the heat that the gas exchanges with its walls makes c = K″/ω grow without end."
        " Crosses in (a, b, f): wind and track at once, the platform by 10 mm. Toward the bolster's own frequency it"
        " shears the springs more and more, from 0.3 to 6 mm, so that K′ falls by amplitude where a sine of one"
        " amplitude is flat over frequency. In (f) those are left out whose uncertainty is larger than they are.",
        figure_11,
    ),
    Picture(
        "comfort",
        "Table. Acceleration of the car body and ride comfort",
        "Half a car at 100 km/h, with 5 mm of track excitation and gusts from a spectrum: rms of the"
        " lateral acceleration at the floor, and N = 6 a<sub>YP95</sub> (ENV 12299, W<sub>d</sub>, 5-s"
        " rms values, 95th percentile of five minutes). Solid: the car of three degrees of freedom on"
        " the plant's springs, with the anti-roll bar of the benchmark car that its masses and heights come"
        " from; dotted: the same car without the bar. Dashed: the paper's equation (28).",
        comfort,
    ),
)

GLOBAL: Final = Picture(
    "sensitivity",
    "Global sensitivity of the geometric parameters",
    "Sobol indices (<code>scipy.stats.sobol_indices</code>): the share of an output's variance that"
    " comes from a parameter, alone (first order) or with what it does together with others (total)."
    f" Each parameter is spread evenly over ± {100 * SPREAD:.0f} % (assumed), AW0, and the load stays: a"
    " larger effective area is a lower pressure. At the paper's pressure ratio of 0.98 its orifice"
    " stands at the maximum of its damping and moves nothing.",
    sensitivity,
)

_PICTURES: Final = {one.name: one for one in (*SECTIONS, GLOBAL)}


def draw(name: str, study: Study, out: Path) -> str:
    """Draw the picture of this name into ``out`` as SVG and PNG; return it as an element for a page."""
    with style():
        figure = _PICTURES[name].draw(study)
        plain_numbers(figure)
        # The layout is solved once, not for each file.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        drawing = out / f"{name}.svg"
        figure.savefig(drawing, metadata={"Date": None, "Creator": None})
        figure.savefig(out / f"{name}.png", dpi=150, metadata={"Software": None})
    return element(drawing.read_text(encoding="utf-8"), name)
