"""Points in Modbus tables against pymodbus' own coding, and every description that cannot be."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.client.mixin import ModbusClientMixin as Client

from drivers.errors import WiringError
from drivers.wiring.modbus.registers import RegisterPoint, read_points, spans

TYPES = ("int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64")
GROUPS = ("fast", "slow")


def points(**tables: dict) -> dict[str, RegisterPoint]:
    return read_points("plant.toml: transports.plc.points", tables, GROUPS, "high", "big")


def point(**keys: object) -> RegisterPoint:
    return points(height={"table": "holding", "address": 10, **keys})["height"]


@st.composite
def numbers(draw: st.DrawFn) -> tuple[str, float]:
    kind = draw(st.sampled_from(TYPES))
    if kind.startswith("float"):
        return kind, draw(st.floats(width=int(kind[5:]), allow_nan=False, allow_infinity=False))
    bits = min(int(kind.removeprefix("u")[3:]), 53)  # what a float carries exactly
    low = 0 if kind.startswith("u") else -(2 ** (bits - 1))
    return kind, draw(st.integers(low, low + 2**bits - 1))


@given(numbers(), st.sampled_from(["high", "low"]))
def test_pymodbus_reads_what_we_write_and_the_reverse(number: tuple[str, float], order: str) -> None:
    kind, value = number
    ours = point(type=kind, word_order=order)
    foreign, data_type = ("big" if order == "high" else "little"), Client.DATATYPE[kind.upper()]
    words = Client.convert_to_registers(value, data_type, foreign)
    assert ours.encode(float(value)) == words
    assert ours.decode(words) == value


@given(numbers(), st.sampled_from(["high", "low"]))
def test_swapped_bytes_are_the_same_words_with_their_bytes_swapped(
    number: tuple[str, float], order: str
) -> None:
    kind, value = number
    plain = point(type=kind, word_order=order).encode(float(value))
    swapped = point(type=kind, word_order=order, byte_order="little")
    assert swapped.encode(float(value)) == [(word & 0xFF) << 8 | word >> 8 for word in plain]
    assert swapped.decode(swapped.encode(float(value))) == value


@given(
    st.sampled_from(["int16", "uint16", "int32", "uint32"]),
    st.floats(0.001, 100).map(lambda scale: round(scale, 3)) | st.just(-0.01),
    st.floats(-1000, 1000),
    st.floats(0, 1),
)
def test_a_scaled_number_comes_back_within_half_a_step(
    kind: str, scale: float, offset: float, fraction: float
) -> None:
    ours = point(type=kind, scale=scale, offset=offset)
    low, high = ours.range()
    value = low + fraction * (high - low)
    assert ours.decode(ours.encode(value)) == pytest.approx(
        value, abs=0.5001 * abs(scale) + 1e-9 * abs(value)
    )


@pytest.mark.parametrize("swapped", ["big", "little"])
@given(word=st.integers(0, 0xFFFF), bit=st.integers(0, 15), value=st.booleans())
def test_writing_a_bit_keeps_the_other_bits_of_its_word(
    swapped: str, word: int, bit: int, value: bool
) -> None:
    ours = point(bit=bit, byte_order=swapped)
    changed = ours.with_bit(word, float(value))
    assert ours.decode([changed]) == value
    assert bin(changed ^ word).count("1") == (ours.decode([word]) != value)
    if swapped == "big":
        assert ours.decode([word]) == (word >> bit & 1)


@pytest.mark.parametrize("swapped", ["big", "little"])
@given(data=st.data())
def test_a_field_of_bits_is_a_number_and_leaves_the_rest_of_its_word(
    swapped: str, data: st.DataObject
) -> None:
    bits = data.draw(st.integers(1, 16))
    bit = data.draw(st.integers(0, 16 - bits))
    word, value = data.draw(st.integers(0, 0xFFFF)), data.draw(st.integers(0, 2**bits - 1))
    ours = point(bit=bit, bits=bits, byte_order=swapped)
    changed = ours.with_bit(word, float(value))
    assert ours.decode([changed]) == value
    assert ours.with_bit(changed, ours.decode([word])) == word  # nothing else was changed
    held = word if swapped == "big" else (word & 0xFF) << 8 | word >> 8
    assert ours.decode([word]) == held >> bit & (2**bits - 1)
    assert ours.range() == (0, 2**bits - 1)


def test_no_value_is_nan_and_back() -> None:
    ours = point(type="int16", scale=0.1, null=[-32768, 32767])
    assert math.isnan(ours.decode([0x8000]))
    assert math.isnan(ours.decode([0x7FFF]))
    assert ours.decode([0x7FFE]) == pytest.approx(3276.6)
    assert ours.encode(math.nan) == [0x8000]
    assert math.isnan(point(type="float32").decode([0x7FC0, 0]))


@pytest.mark.parametrize("order", ["big", "little"])
def test_a_text(order: str) -> None:
    ours = point(type="string", length=4, word_order="low", byte_order=order)
    words = Client.convert_to_registers("PLC 7\0\0\0", Client.DATATYPE.STRING)
    if order == "little":
        words = [(word & 0xFF) << 8 | word >> 8 for word in words]
    assert ours.text(words) == "PLC 7"


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (
            {"type": "int16", "scale": 0.01},
            400.0,
            r"height = 400 does not fit in int16 .* -327\.68 to 327\.67",
        ),
        ({"type": "uint16"}, -1.0, r"height = -1 does not fit in uint16 at 10 with scale 1; use 0 to 65535"),
        ({"type": "float32"}, 1e39, "height = 1e\\+39 does not fit in float32"),
        ({"type": "int16"}, math.nan, "height = nan is not a number to write"),
        ({"type": "float64"}, math.inf, "height = inf is not a number"),
        ({"bit": 3}, 2.0, r"height = 2 is not a bit \(0 or 1\)"),
        ({"bit": 3, "bits": 4}, 16.0, r"height = 16 is not 4 bits \(0 to 15\)"),
    ],
)
def test_values_outside_the_register_are_refused(keys: dict, value: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        point(**keys).encode(value)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"adress": 3}, "points: height: there is no key 'adress' here; did you mean 'address'"),
        ({"table": "inputs"}, "height: table = 'inputs'"),
        ({"address": 65536}, "height: address = 65536; use a whole number <= 65535"),
        ({"address": -1}, "height: address = -1"),
        ({"address": 65535, "type": "int32"}, "address = 65535 with 2 registers exceeds 65535"),
        ({"type": "int24"}, "height: type = 'int24'"),
        ({"type": "bit"}, r"type = 'bit' in a register needs bit = 0 \(the lowest\) to 15"),
        ({"bit": 16}, "height: bit = 16"),
        ({"bit": 12, "bits": 5}, "bits = 5 from bit = 12 on go beyond bit 15"),
        ({"type": "int16", "bits": 3}, "bits = 3 has no meaning for type = 'int16'"),
        ({"table": "coil", "bits": 3}, "bits = 3 has no meaning for a coil"),
        ({"bit": 3, "type": "int16"}, "bit = 3 has no meaning for type = 'int16'"),
        ({"table": "coil", "type": "int16"}, "type = 'int16' does not fit in a coil"),
        ({"table": "discrete", "bit": 2}, "bit = 2 has no meaning in a discrete"),
        ({"type": "string"}, "a string needs length"),
        ({"type": "int16", "length": 2}, "length = 2 is for type = 'string'"),
        ({"scale": 0.0}, "scale = 0, offset = 0 map all values to one number"),
        ({"bit": 1, "scale": 2.0}, "scale, offset and null are for numbers; remove them for a bit"),
        (
            {"type": "int16", "null": 40000},
            r"null = 40000 does not fit into int16 \(-32768 to 32767\)",
        ),
        ({"group": "fats"}, "group = 'fats' is not among .groups.; did you mean 'fast'"),
        ({"word_order": "middle"}, "word_order = 'middle'"),
    ],
)
def test_a_point_that_cannot_be(keys: dict, words: str) -> None:
    with pytest.raises(WiringError, match=words) as caught:
        point(**keys)
    assert str(caught.value).startswith("plant.toml: transports.plc.points: height")


def test_points_that_cannot_both_be() -> None:
    def both(first: dict, second: dict) -> None:
        points(a={"table": "input", **first}, b={"table": "input", **second})

    both({"address": 5, "bit": 3}, {"address": 5, "bit": 4})
    both({"address": 5, "bit": 3}, {"address": 5, "type": "uint16"})
    both({"address": 5, "type": "float32"}, {"address": 7})
    for first, second in (
        ({"address": 5, "bit": 3}, {"address": 5, "bit": 3}),
        ({"address": 5}, {"address": 5}),
        ({"address": 5, "type": "float32"}, {"address": 6, "type": "int16"}),
        ({"address": 5, "type": "float32"}, {"address": 6, "bit": 0}),
        ({"address": 6}, {"address": 0, "type": "string", "length": 20}),
    ):
        with pytest.raises(WiringError, match="share a register; correct one address, or remove one point"):
            both(first, second)
    with pytest.raises(WiringError, match=r"a \(bit in coil 5\) and b \(bit in coil 5\) share a coil"):
        points(a={"table": "coil", "address": 5}, b={"table": "coil", "address": 5})


def test_names_and_no_points_at_all() -> None:
    with pytest.raises(WiringError, match="2nd is not a valid name"):
        read_points("plc", {"2nd": {"table": "input", "address": 0}}, (), "high", "big")
    with pytest.raises(WiringError, match="there are no points"):
        read_points("plc", {}, (), "high", "big")
    with pytest.raises(WiringError, match="height = 7 is not a table"):
        read_points("plc", {"height": 7}, (), "high", "big")


@given(
    st.lists(st.tuples(st.integers(0, 400), st.sampled_from(["int16", "int32", "float64"])), min_size=1),
    st.integers(0, 20),
)
def test_requests_cover_every_point_once_and_are_never_too_long(places: list, gap: int) -> None:
    tables, taken = {}, set()
    for address, kind in places:
        size = {"int16": 1, "int32": 2, "float64": 4}[kind]
        if taken.isdisjoint(range(address, address + size)):
            taken.update(range(address, address + size))
            tables[f"p{address}"] = {"table": "input", "address": address, "type": kind}
    made = points(**tables)
    requests = spans(made.values(), gap)
    assert sorted(one.name for request in requests for one in request.points) == sorted(made)
    for request in requests:
        assert 1 <= request.count <= 125
        read = set(range(request.address, request.address + request.count))
        for one in request.points:
            assert set(range(one.address, one.end)) <= read
        holes = sorted(read - taken)
        assert all(k in taken or k in holes for k in read)
        assert len(holes) <= gap * (len(request.points) - 1)
    covered = [k for request in requests for k in range(request.address, request.address + request.count)]
    assert len(covered) == len(set(covered))
