"""Rules of the diagnosis, switched off one at a time."""

import pytest

from astb_studies.benchmarks.diagnosis.ablation import FIRST_SEED, RULES, ablate, outcome
from astb_studies.benchmarks.diagnosis.campaign import Case, carry_out

#: A sibling whose form is called a cause without the constancy test.
ACCUSED = Case("oscillator", "null", "sibling", FIRST_SEED + 200_002)


def test_a_replaced_rule_returns_to_every_module():
    from diagnosis.engine import admission, family, trials

    (rule,) = (one for one in RULES if one.function == "richer_surcharge")
    original = rule.original
    with rule.replaced(rule.off):
        assert admission.richer_surcharge is trials.richer_surcharge is family.richer_surcharge is rule.off
    assert admission.richer_surcharge is trials.richer_surcharge is family.richer_surcharge is original


@pytest.mark.slow
def test_only_rules_that_acted_are_switched_off():
    """Observation changes no judgement; without the constancy test, a form is called a cause."""
    found = ablate(ACCUSED)
    assert found.outcome == outcome(carry_out(ACCUSED))
    assert not found.outcome.false
    assert 0 < len(found.without) < len(RULES)
    assert found.without["constancy"].false
