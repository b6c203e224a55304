"""Reservations in the panel: everyone sees them, who has the token changes them."""

from datetime import UTC, datetime, timedelta

import pytest

from astb.reservations import reservations

NOW = datetime.now(UTC).replace(microsecond=0)


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def body(by: str, start: int, end: int, **more: str) -> dict[str, str]:
    hour = timedelta(hours=1)
    return {"by": by, "start": (NOW + start * hour).isoformat(), "end": (NOW + end * hour).isoformat()} | more


def test_a_page_with_the_token_adds_and_removes_reservations(client, parts):
    page, second, watching = client(), client("two"), client(command=False)
    assert (
        page.post("/api/reservations/add", json=body("A. Miller", 0, 2, purpose="endurance")).status_code
        == 200
    )
    assert second.post("/api/reservations/add", json=body("B. Smith", 2, 3)).status_code == 200
    overlapping = second.post("/api/reservations/add", json=body("C. Jones", 1, 3))
    assert overlapping.status_code == 409 and "A. Miller" in overlapping.json()["error"]
    listed = watching.get("/api/reservations").json()
    assert [(one["by"], one["purpose"]) for one in listed] == [("A. Miller", "endurance"), ("B. Smith", "")]
    assert datetime.fromisoformat(listed[1]["start"]) == NOW + timedelta(hours=2)
    assert [one.by for one in reservations(parts.watch.path)] == ["A. Miller", "B. Smith"], (
        "as astb run reads it"
    )
    assert page.post("/api/reservations/remove", json={"start": listed[0]["start"]}).status_code == 200
    assert [one["by"] for one in watching.get("/api/reservations").json()] == ["B. Smith"]


@pytest.mark.parametrize(
    ("what", "wrong"),
    [
        ("add", {}),
        ("add", body("A", 0, 1) | {"end": "tomorrow"}),
        ("add", body("A", 0, 1) | {"end": (NOW + timedelta(hours=1)).replace(tzinfo=None).isoformat()}),
        ("add", body("A", 0, 1) | {"rig": "other"}),
        ("add", body("A", 0, 1) | {"by": 7}),
        ("remove", {}),
        ("remove", {"start": "never"}),
    ],
)
def test_other_data_are_refused(client, parts, what, wrong):
    assert client().post(f"/api/reservations/{what}", json=wrong).status_code == 400
    assert reservations(parts.watch.path) == []


def test_an_observer_cannot_change_reservations(client, parts):
    client().post("/api/reservations/add", json=body("A. Miller", 0, 2))
    (kept,) = reservations(parts.watch.path)
    watching = client(command=False)
    assert watching.post("/api/reservations/add", json=body("B. Smith", 3, 4)).status_code == 403
    assert (
        watching.post("/api/reservations/remove", json={"start": kept.start.isoformat()}).status_code == 403
    )
    assert reservations(parts.watch.path) == [kept]
