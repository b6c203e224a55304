"""Readings of load cells at any place and in any direction: statics of a rigid body is the oracle."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.dimensions import (
    LOAD_CELLS,
    DimensionsError,
    direction,
    lag,
    ordinary,
    place,
    read_dimensions,
)
from bench_records.record import read as read_record
from bench_records.result import Outcome
from drivers.errors import NotAvailable
from test_plans.analysis import cells
from test_plans.description import Description, once_for_a_rig, ours
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.instruments import ordinary as ordinary_instruments
from tests.foreign import virtual, wiring_file
from tests.foreign.plc_rig import _words
from tests.foreign.virtual import VirtualPlc
from tests.refusals import refuses

HEIGHT = ours()["column_height"]
SPACING = ours()["spring_half_spacing"]
UPRIGHT, ACROSS = LOAD_CELLS[:4], LOAD_CELLS[4:6]
#: Where rig A has nothing in its process image.
FURTHER_CELLS = 50


def put(rig, cell, at, along):
    """Return a rig with a cell that stands and points so."""
    return rig | dict(zip(place(cell), at, strict=True)) | dict(zip(direction(cell), along, strict=True))


def struts(count=6):
    """Inclined struts below a platform, six as a hexapod has them: place (m) and direction of each."""
    for number in range(count):
        angle, lean = np.radians(360 / count * number + 20), 0.5 * (-1) ** number
        along = np.array([-lean * np.sin(angle), lean * np.cos(angle), 0.85])
        yield (0.9 * np.cos(angle), 1.2 * np.sin(angle), 0.05), along / np.linalg.norm(along)


def on_struts(count=6):
    rig = dict(ours())
    for cell, (at, along) in zip(LOAD_CELLS, struts(count), strict=False):
        rig = put(rig, cell, at, along)
    return rig


def columns(rig):
    """Force and moment about the middle between the top plates of one newton in each cell, by the cross product."""
    found = []
    for cell in cells.described(rig):
        at, along = (np.array([rig[name] for name in names(cell)]) for names in (place, direction))
        found.append(np.concatenate([along, np.cross(at - [0, 0, HEIGHT], along)]))
    return np.array(found).T


numbers = st.floats(-1.0, 1.0)


@st.composite
def arrangements(draw):
    """Six to eight cells at any place and in any direction, which give all six components."""
    rig = dict(ours())
    for cell in LOAD_CELLS[: draw(st.integers(6, 8))]:
        along = np.array([draw(numbers), draw(numbers), draw(st.floats(0.2, 1.0))])
        rig = put(rig, cell, [draw(numbers) for _ in range(3)], along / np.linalg.norm(along))
    return rig


@given(arrangements(), st.lists(st.floats(-1e5, 1e5), min_size=8, max_size=8))
def test_a_wrench_is_what_the_cells_balance(rig, forces):
    read = dict(zip(cells.described(rig), map(np.asarray, forces), strict=False))
    expected = columns(rig) @ np.array(forces[: len(read)])
    assert np.array(cells.wrench(read, rig)) == pytest.approx(expected, abs=1e-6)


@given(st.floats(0.0, 1.5e5), st.floats(0.0, 1.5e5), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_struts_give_spring_loads_and_lateral_force(left, right, sheared, ahead):
    """Springs push the bolster up and sideways at their top plates: whichever cells bear that, it is the same."""
    forces = np.array([ahead, sheared, left + right, SPACING * (left - right), 0.0, 0.0])
    for rig in (on_struts(), on_struts(8), dict(ours())):
        carried = np.linalg.lstsq(columns(rig), forces, rcond=None)[0]
        read = dict(zip(cells.described(rig), carried, strict=True))
        assert cells.load_on(read, rig, "left") == pytest.approx(left, abs=1e-4)
        assert cells.load_on(read, rig, "right") == pytest.approx(right, abs=1e-4)
        assert cells.sideways_force(read, rig) == pytest.approx(sheared, abs=1e-4)
        assert cells.upward_force(read, rig) == pytest.approx(left + right, abs=1e-4)


def test_parts_that_cells_cannot_measure_are_named():
    assert cells.unseen(ours()) == ("force ahead",)
    assert cells.unseen(ours(), UPRIGHT) == ("force ahead", "force sideways", "yaw moment")
    assert cells.unseen(ours(), ACROSS) == cells.PARTS[:-1]  # a force sideways may be a roll moment there
    assert cells.unseen(on_struts()) == cells.unseen(on_struts(8)) == ()
    assert cells.unseen(ours(), ()) == cells.PARTS
    assert set(cells.unseen(on_struts(), LOAD_CELLS[:5])) == set(cells.PARTS)


def test_which_cells_are_read_for_what():
    assert (cells.bearing(ours()), cells.guiding(ours())) == (UPRIGHT, ACROSS)
    assert cells.bearing(on_struts()) == cells.guiding(on_struts()) == LOAD_CELLS[:6]
    assert cells.bearing(on_struts(8)) == cells.guiding(on_struts(8)) == LOAD_CELLS
    nobody = Description("hall", replace(ordinary(), known={}))
    assert (cells.bearing(nobody), cells.guiding(nobody)) == (UPRIGHT, ACROSS)
    with refuses(NotAvailable, "load_cell.1"):
        cells.upward_force(dict.fromkeys(UPRIGHT, np.zeros(3)), nobody)
    with refuses(NotAvailable, "load_cell.2 load_cell.3 load_cell.4"):
        cells.upward_force({"load_cell.1": np.zeros(3)}, ours())


def test_a_direction_of_any_length_and_unit_is_a_unit_vector(tmp_path):
    (tmp_path / "mine.toml").write_text(
        "[load_cell.5]\ndirection = { value = [0, 120, 160], uncertainty = 2, "
        'unit = "%", provenance = "assumed", source = "x" }',
        encoding="utf-8",
    )
    known = read_dimensions("mine.toml", tmp_path).known
    assert [known[name].value for name in direction("load_cell.5")] == pytest.approx([0.0, 0.6, 0.8])
    assert [known[name].uncertainty for name in direction("load_cell.5")] == pytest.approx([0.01] * 3)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (
            '[load_cell.1]\nplace = { value = 1.0, unit = "m" }',
            "is not three numbers",
        ),
        ("[load_cell.1]\nstands = 1", "load_cell.1.stands is not a key of a load cell"),
        ("[load_cell.9]\nplace = 1", "load_cell.9 is not a load cell"),
        (
            '[load_cell.1]\ndirection = { value = [0, 0, 0], unit = "1", provenance = "assumed", source = "x" }',
            "load_cell.1.direction = [0, 0, 0] has no direction",
        ),
        (
            '[load_cell.1]\nplace = { value = [0, 0, 0], unit = "kg", provenance = "assumed", source = "x" }',
            "load_cell.1.place = 0 kg has the wrong unit",
        ),
        ('[across]\n"load_cell.1" = 1', 'across."load_cell.1" is not a dimension of a rig'),
    ],
)
def test_a_wrong_key_of_a_cell_is_reported(tmp_path, line, told):
    (tmp_path / "mine.toml").write_text(line, encoding="utf-8")
    with pytest.raises(DimensionsError) as error:
        read_dimensions("mine.toml", tmp_path)
    assert told in str(error.value)


def put_on_struts(monkeypatch, stranger, count):
    """Put the platform of a stranger on struts: each reads what it bears of the same force and moment."""
    rig = stranger.rig
    theirs = dict(Description("rig", stranger.bench().dimensions))
    turn = np.linalg.lstsq(columns(theirs | struts_of(count)), columns(theirs), rcond=None)[0]
    read = rig.machine.read

    def read_struts(name):
        if not name.startswith("load_cell_"):
            return read(name)
        return float(turn[int(name[-1]) - 1] @ [read(f"load_cell_{number}") for number in range(1, 7)])

    def publish_all():
        """Write a process image, with the further cells where rig A has nothing."""
        publish()
        for number in range(7, count + 1):
            at = FURTHER_CELLS + 2 * (number - 7)
            rig._image[at : at + 2] = _words(round(read_struts(f"load_cell_{number}")))

    publish = rig._publish
    monkeypatch.setattr(rig.machine, "read", read_struts)
    monkeypatch.setattr(rig, "_publish", publish_all)


def with_cells(wiring, count):
    """Add lines for further load cells to the text of a wiring."""
    for number in range(7, count + 1):
        address = FURTHER_CELLS + 2 * (number - 7)
        point = f'cell_{number} = {{ table = "input", address = {address}, type = "int32", group = "image" }}'
        wiring = wiring.replace("platform_up =", f"{point}\nplatform_up =", 1)
        line = f'"load_cell.{number}" = {{ from = "plc.cell_{number}", unit = "N" }}'
        wiring = wiring.replace('"load_cell.6" =', f'{line}\n"load_cell.6" =', 1)
    return wiring


def described_struts(bench, count):
    """Return the dimensions of a stranger with those of its struts."""
    known = dict(bench.dimensions.known)
    for name, value in struts_of(count).items():
        known[name] = replace(known[name.replace(".7", ".1").replace(".8", ".1")], value=value)
    return known | {lag(cell): known[lag("load_cell.1")] for cell in LOAD_CELLS[6:count]}


def struts_of(count):
    return {
        name: float(value)
        for name, value in on_struts(count).items()
        if name.startswith("load_cell.") and "lag" not in name
    }


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, 8])
def test_a_rig_on_struts_is_judged_by_its_own_description_and_by_no_other(monkeypatch, tmp_path, count):
    """A sound spring passes where the file states the cells' directions, and cannot where it says they are upright."""
    wiring = tmp_path / "wiring.toml"
    wiring.write_text(with_cells(wiring_file("plant_a").read_text(encoding="utf-8"), count), encoding="utf-8")
    monkeypatch.setattr(virtual, "wiring_file", lambda name: wiring)
    verdicts = {}
    for described in (True, False):
        stranger = VirtualPlc()
        put_on_struts(monkeypatch, stranger, count)
        with stranger.bench() as bench:
            if described:
                bench.dimensions = replace(bench.dimensions, known=described_struts(bench, count))
            bench.instruments = ordinary_instruments()
            result = execute(plans()["aw0"], bench, tmp_path / str(described), rig="struts", seed=1)
            assert all(bench.has(f"load_cell.{number}") is (number <= count) for number in range(1, 9))
        verdicts[described] = result
    judged = [one for one in verdicts[True].checks if one.number == one.number]
    assert len(judged) > 20
    assert [one.name for one in judged if not one.passed] == []
    assert verdicts[False].verdict is Outcome.FAIL
    recorded = read_record(tmp_path / "True").signals
    assert [name for name in LOAD_CELLS if name in recorded] == list(LOAD_CELLS[:count])


def test_what_follows_from_a_description_is_found_once_and_from_what_changes_anew():
    rig, asked = ours(), []

    @once_for_a_rig
    def tilted(of, name):
        asked.append(name)
        return of[name] + 1.0

    name = direction(UPRIGHT[0])[2]
    assert tilted(rig, name) == tilted(rig, name) == rig[name] + 1.0
    assert asked == [name]
    moved = {**rig, name: 0.5}
    assert tilted(moved, name) == 1.5
    moved[name] = 0.25
    assert tilted(moved, name) == 1.25
    for cell in cells.described(rig):
        assert cells.pointing(rig, cell) == cells.pointing(dict(rig), cell)
        assert cells.column_of(rig, cell) == cells.column_of(dict(rig), cell)
    assert cells.bearing(rig, cells.SOME) == cells.bearing(dict(rig), cells.SOME)
