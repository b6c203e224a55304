"""A cause that is hidden in the bench is found from the recorded signals, with the whole catalogue."""

from astb.diagnose import read_data
from bench_protocol.units import Hz, mm, s
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from test_plans.programmes.motions import RestPose, Stretch, Wave

#: A screening of a quarter of a minute. Its conditioning is short because friction is not identified.
SHORT = Stretch(
    (Wave("vertical", 4 * mm, 1.25 * Hz, 4), RestPose(8 * mm, rest=3 * s)),
    condition=(Wave("vertical", 10 * mm, 1 * Hz, 3),),
)
BLOCKED = 0.1


def test_a_blocked_orifice_is_named_among_all_causes(bench_record):
    made = bench_record("blocked", [SHORT], effects={"blocked_orifice.left": {"share": BLOCKED}}, seed=3)
    simulator, dataset = read_data([made.directory], None, made.parameters)
    config = Config(fits=2, max_effects=1, workers=1, with_panel=False, with_gain=False)
    finding = diagnose(dataset, simulator, config)
    assert (finding.verdict, [cause.effect for cause in finding.causes]) == (
        "named",
        ["blocked_orifice.left"],
    )
    (share,) = finding.causes[0].parameters
    assert share.low * 0.01 <= BLOCKED <= share.high * 0.01
    assert share.high - share.low < share.value, "it is measured, not only seen"
