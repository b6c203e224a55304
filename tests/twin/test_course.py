"""The course of a deviation in words: reported, surer, changed, withdrawn, over."""

import pytest
from msgspec.structs import replace

from bench_records.twin import PARTS, Deviation, PossibleCause, TwinStory
from bench_sim.model.effects import CATALOGUE as EFFECTS
from bench_sim.parameters import load
from diagnosis.systems.air_spring.simulator import AirSpring, channels
from diagnosis.twin import course

CHANNEL = channels(load("astb"))[0]
CATALOGUE = AirSpring(load("astb"), effects=EFFECTS).catalogue


def cause(name: str, low: float = 0.4, high: float = 0.6, form: str = "at once") -> PossibleCause:
    return PossibleCause(name, name, 0.5, low, high, "0.5 mm2", form, 60.0)


def deviation(*causes: PossibleCause, pairs=()) -> Deviation:
    return Deviation(62.0, 60.0, CHANNEL.name, 1.0, 2.0, 0.1, causes, pairs=pairs)


def begun(*causes: PossibleCause) -> Deviation:
    one = deviation(*causes)
    return course.extend_deviation(one, one, 63.0)


def words(one: Deviation) -> list[str]:
    return [said.word for said in one.course]


def test_repeated_messages_are_stored_once():
    first = begun(cause("leak.left"))
    assert words(first) == ["told"]
    assert words(course.extend_deviation(first, deviation(cause("leak.left", 0.41, 0.59)), 70.0)) == ["told"]


def test_fewer_causes_or_a_narrower_size_are_surer():
    first = begun(cause("leak.left"), cause("leak_laminar.left"))
    fewer = course.extend_deviation(first, deviation(cause("leak.left")), 70.0)
    assert words(fewer) == ["told", "surer"] and fewer.detected == first.detected
    narrower = course.extend_deviation(fewer, deviation(cause("leak.left", 0.45, 0.55)), 80.0)
    assert words(narrower) == ["told", "surer", "surer"]


def test_other_causes_or_another_form_or_two_at_once_are_otherwise():
    first = begun(cause("leak.left"))
    pair = (cause("leak.left"), cause("cell_offset.2"))
    for other in (
        deviation(cause("compliance")),
        deviation(cause("leak.left", form="growing")),
        deviation(pairs=(pair,)),
    ):
        assert words(course.extend_deviation(first, other, 70.0)) == ["told", "otherwise"]


def test_what_is_withdrawn_or_over_does_not_last_and_says_so():
    first = begun(cause("leak.left"))
    back = course.described(course.withdrawn(first, 71.0), CHANNEL)
    assert not back.lasts and words(back)[-1] == "withdrawn"
    assert "71.0 s" in back.sentence
    past = course.described(course.over(first, 80.0, 95.0), CHANNEL)
    assert not past.lasts and words(past)[-1] == "over"
    assert "80.0 s" in past.sentence
    assert TwinStory("astb", 99.0, (), (first, past)).present_deviation == first
    assert TwinStory("astb", 99.0, (), (past,)).present_deviation is None


@pytest.mark.parametrize("causes", [(), ("leak.left",), ("leak.left", "compliance")])
def test_a_summary_has_four_parts_and_each_time_once(causes):
    one = replace(deviation(*map(cause, causes)), detected=62.04, since=60.26, earliest=59.31, latest=61.57)
    summary = course.described(one, CHANNEL, {"leak.left": CATALOGUE["leak.left"]}).summary
    parts = {name: getattr(summary, name) for name in PARTS}
    assert all(parts.values()) and CHANNEL.name in parts["wrong"]
    assert all(time in parts["wrong"] for time in ("60.3 s", "59.3", "61.6 s"))
    assert "62.0 s" in parts["evidence"]
    assert all(name in parts["sure" if k else "wrong"] for k, name in enumerate(causes))


def test_later_sections_reduce_the_possible_causes():
    first = begun(cause("leak.left"), cause("leak_laminar.left"))
    later = deviation(cause("leak.left", 0.45, 0.55), cause("compliance"))
    assert course.is_the_same(first, later)
    after = course.lasting(first, later, 130.0)
    assert [one.name for one in after.causes] == ["leak.left"]
    assert after.since == first.since and words(after) == ["told", "surer"]
    assert not course.is_the_same(first, deviation(cause("compliance")))
    assert not course.is_the_same(first, deviation())
    assert course.is_the_same(begun(), deviation())


def test_a_step_back_in_a_later_stretch_is_its_end():
    first = begun(cause("cell_offset.2"))
    back = Deviation(
        160.0,
        158.0,
        CHANNEL.name,
        1.0,
        2.0,
        0.1,
        (PossibleCause("cell_offset.2", "", -0.52, -0.6, -0.4, "", since=158.0),),
    )
    after = course.lasting(first, back, 170.0)
    assert after.over == 158.0 and after.causes == first.causes and words(after) == ["told", "over"]


def test_an_untested_cause_is_explained_or_unknown_afterwards():
    first = Deviation(62.0, 60.0, CHANNEL.name, 1.0, 2.0, 0.1, searched=False)
    told = course.extend_deviation(first, first, 63.0)
    assert "search" in course.described(told, CHANNEL).sentence
    explained = course.extend_deviation(told, deviation(cause("leak.left")), 63.0)
    assert words(explained) == ["told", "explained"] and explained.searched
    unknown = course.extend_deviation(told, deviation(), 63.0)
    assert words(unknown) == ["told", "unknown"]
    assert "No single cause" in course.described(unknown, CHANNEL).sentence


def test_a_second_deviation_joins_the_first_until_its_causes_are_known():
    lasting = begun(cause("leak.left"))
    new = Deviation(162.0, 160.0, CHANNEL.name, 1.0, 2.0, 0.1, searched=False)
    assert course.joined((lasting,), course.extend_deviation(new, new, 163.0)) == (lasting,)
    over = course.over(lasting, 80.0, 95.0)
    assert len(course.joined((over,), course.extend_deviation(new, new, 163.0))) == 2
    known = course.extend_deviation(new, deviation(cause("compliance")), 163.0)
    assert len(course.joined((lasting,), known)) == 2
    assert course.joined((lasting,), None) == (lasting,)


def test_a_deviation_after_withdrawal_is_reported_again():
    back = course.withdrawn(begun(cause("leak.left")), 71.0)
    again = course.extend_deviation(back, deviation(cause("leak.left")), 75.0)
    assert again.lasts and words(again) == ["told", "withdrawn", "told"]
