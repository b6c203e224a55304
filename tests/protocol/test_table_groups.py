"""A row of the table of sensor groups is complete and consistent, or the import names row and field."""

from dataclasses import MISSING, fields, replace

import pytest

from bench_protocol.signals import Group
from bench_protocol.table_groups import SensorRow
from bench_protocol.table_signals import BY_GROUP, MEASUREMENTS

OPTIONAL = {"noise_provenance"}


def test_all_groups_are_used_and_have_names_of_their_own():
    assert all(BY_GROUP.values())
    assert (
        len({group.row.panel for group in Group})
        == len({group.row.instrument for group in Group})
        == len(Group)
    )
    for signal in MEASUREMENTS:
        row = signal.group.row
        assert (signal.unit, (signal.low, signal.high), signal.step) == (row.unit, row.carried, row.step)


def test_a_group_is_its_name():
    assert Group("height") is Group.HEIGHT
    assert f"{Group.HEIGHT}" == Group.HEIGHT.value == "height"


@pytest.mark.parametrize("field", [one.name for one in fields(SensorRow)])
def test_a_row_without_one_of_its_fields_is_refused(field):
    row = Group.HEIGHT.row
    given = {one.name: getattr(row, one.name) for one in fields(SensorRow) if one.name != field}
    assert ({one.name for one in fields(SensorRow) if one.default is not MISSING}) == OPTIONAL
    if field in OPTIONAL:
        assert SensorRow(**given) == row
    else:
        with pytest.raises(TypeError, match=field):
            SensorRow(**given)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("panel", ""),
        ("unit", "furlong"),
        ("carried", (0.1, -0.1)),
        ("at_rest", (-1.0, 0.1)),
        ("reads", (0.0, 0.0)),
        ("step", 0.0),
        ("accuracy", 1.0),
        ("noise", float("nan")),
        ("gain", -0.1),
        ("lag", -1.0),
        ("noise_provenance", "rumour"),
    ],
)
def test_invalid_fields_are_refused_with_row_field_and_value(field, value):
    with pytest.raises(ValueError, match=rf"height\.{field} = ") as error:
        replace(Group.HEIGHT.row, **{field: value})
    assert repr(value) in str(error.value)
