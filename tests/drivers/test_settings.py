"""Settings reach the rig all or none; probes, map hash and lease are checked before anything is commanded."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import bar, mm
from drivers.errors import LinkLost, MapMismatch, Misuse, NotCommander, Refused
from drivers.wiring.astb.modbus import from_words, single, to_words
from tests.refusals import refuses

SETTINGS = TABLE.of_kind(Kind.SETTING)
WRITES = (5, 6, 15, 16, 22, 23)


@given(st.floats(width=32, allow_nan=False))
def test_words_are_ieee_singles_high_word_first(value):
    high, low = to_words(value)
    assert struct.pack(">HH", high, low) == struct.pack(">f", value)
    assert from_words(high, low) == value == single(value)


def writes(peer):
    return [code for code in peer.requests if code in WRITES]


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_what_fits_is_applied_and_what_does_not_is_never_sent(make_world, data):
    world = make_world()
    names = data.draw(
        st.lists(st.sampled_from([r.name for r in SETTINGS]), min_size=1, max_size=5, unique=True)
    )
    values = {
        name: float(data.draw(st.integers(-1, len(TABLE[name].choices))))
        if TABLE[name].choices
        else data.draw(st.floats(TABLE[name].low * 0.9 - 0.1, TABLE[name].high * 1.1 + 0.1))
        for name in names
    }
    fits = all(TABLE[name].low <= value <= TABLE[name].high for name, value in values.items())
    before = dict(world.peer.settings)
    if fits:
        world.bench.settings.write(values)
        assert world.peer.settings == {name: single(values.get(name, before[name])) for name in before}
        assert writes(world.peer) == [16, 5]  # one request stages everything, one applies it
    else:
        with refuses(ValueError, "use"):
            world.bench.settings.write(values)
        assert writes(world.peer) == []
        assert world.peer.staged == before


@pytest.mark.parametrize(
    ("values", "error", "words"),
    [
        ({"air.left_mode": "levle"}, ValueError, "'levle' is not valid; use hold | level | fill | vent"),
        ({"air.left_mode": 1.5}, ValueError, "not the number of a choice"),
        ({"air.left_target": math.nan}, ValueError, "nan bar does not fit.*0 to 9 bar"),
        ({"air.left_target": 5.0 * bar, "air.right_target": 50 * bar}, ValueError, "50 bar does not fit"),
        ({"air.left_target": "5 bar"}, ValueError, "'5 bar' is not valid; use a number in Pa"),
        ({"left.height": 1 * mm}, Misuse, "left.height is a measurement"),
        ({"air.lleft_mode": "hold"}, KeyError, "no signal"),
    ],
)
def test_bad_values_are_refused_in_words(world, values, error, words):
    with pytest.raises(error, match=words.replace("|", r"\|")):
        world.bench.settings.write(values)
    assert writes(world.peer) == []


def test_what_the_rig_refuses_to_apply_does_not_stay_staged(world):
    world.peer.refuse_apply = True
    before = dict(world.peer.staged)
    with refuses(Refused, "air.left_target 3 bar air.dpv off action.apply"):
        world.bench.settings.write({"air.left_target": 3 * bar, "air.dpv": "off"})
    assert world.peer.staged == before
    world.peer.refuse_apply = False
    world.bench.settings.write({"air.right_target": 2 * bar})
    assert world.peer.settings == before | {"air.right_target": 2 * bar}


def test_an_empty_write_sends_no_frame(world):
    world.bench.settings.write({})
    assert world.peer.requests == []


def test_a_block_is_read_as_one_snapshot(world):
    world.peer.values["left.height"] = 12 * mm
    snapshot = world.bench.wiring.carrier.registers.snapshot()
    assert snapshot["left.height"] == pytest.approx(12 * mm)
    assert set(snapshot) == {r.name for r in TABLE.of_kind(Kind.MEASUREMENT, Kind.STATUS)} & {
        r.signal for r in TABLE.registers if r.space == "input"
    }


def test_a_block_torn_by_a_new_step_is_read_again_and_not_for_ever(world, monkeypatch):
    torn, peer = [2], world.peer
    whole = peer.read_input

    def tearing(address, count):
        words = whole(address, count)
        if torn[0] > 0:
            torn[0] -= 1
            words[-1] ^= 1
        return words

    monkeypatch.setattr(peer, "read_input", tearing)
    assert world.bench.wiring.carrier.registers.snapshot()["left.height"] == 0
    torn[0] = 1000
    with refuses(LinkLost, "20 reads"):
        world.bench.wiring.carrier.registers.snapshot()
    assert torn[0] == 1000 - 2 * 20  # two blocks each


def test_contacts(world):
    world.peer.estop = True
    contacts = world.bench.settings.contacts()
    assert contacts["interlock.estop"] is True
    assert [name for name, on in contacts.items() if on] == ["interlock.estop"]
    assert world.bench.interlock.estop


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda peer: setattr(peer, "map_hash", peer.map_hash ^ 1), "hash"),
        (lambda peer: setattr(peer, "probe_word", 0x56781234), "another"),
        (lambda peer: peer.values.update({"rig.map_hash": 12345.0}), "0x00003039"),
    ],
)
def test_a_rig_with_another_table_is_not_commanded(world, spoil, words):
    spoil(world.peer)
    with refuses(MapMismatch, words):
        world.bench.connect()
    assert all(b["control.enable"] == 0 for _, _, b in world.peer.tracks if b)
    assert world.peer.lease == 0
    with pytest.raises(LinkLost):
        world.can.send(world.peer.advance(10**9))


def test_there_is_one_commander(world):
    world.peer.foreign, world.peer.lease, world.peer.values["rig.lease"] = True, 77, 77.0
    with refuses(NotCommander, "token 77"):
        world.bench.connect()
    assert world.peer.blocks == []
    assert world.peer.lease == 77


def test_the_lease_is_returned(world):
    with world.bench:
        assert world.peer.lease == 0x1234
        assert world.bench.control.token == 0x1234, "what the rig gave"
    assert world.peer.lease == 0


def test_unknown_actions_are_refused(world):
    with refuses(Misuse, "'action.explode'"):
        world.bench.settings.act("action.explode")
