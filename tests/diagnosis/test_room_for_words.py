"""However long its names and large its numbers, a drawing of a diagnosis has room for them, on screen and on paper."""

from typing import Any

import pytest

from diagnosis.finding import Gain, PanelRow
from diagnosis.report.drawings import CAUSES, gain_rows, panel_map
from tests.pictures import LOOK, faults

LONG = "friction grows with the pressure, with presliding, and along the stroke"


def _row(test: int, channel: int) -> PanelRow:
    return PanelRow(
        test=f"test {test}", title=f"{LONG} {test}" if test else "short", run="run",
        channel=f"right.auxiliary_temperature {channel}", statistic=(1 + channel) * 10.0 ** (2 * test), p=0.0, q=0.0,
        sentence="", points_to="", significant=True,
    )  # fmt: skip


def _gain(number: int) -> Gain:
    return Gain(
        channel=f"{LONG} {number}", unit="N", rmse_before=2.0, rmse_after=1.0, floor=1.0, noise_ratio_before=2.0,
        noise_ratio=1.0, nrmse_before=1.0, nrmse_after=0.5, fraction=1.0, fraction_low=0.9, fraction_high=1.0,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("channels", [1, 7, 24])
def test_words_stay_in_their_cells_and_on_the_page(browser: Any, channels: int) -> None:
    drawings = [
        panel_map("panel", [_row(test, channel) for test in range(5) for channel in range(channels)]),
        gain_rows("gains", [_gain(number) for number in range(3)], CAUSES),
    ]
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    for media in ("screen", "print"):
        page.emulate_media(media=media)
        page.set_content(f'<body style="font-family: Liberation Sans">{"".join(drawings)}</body>')
        assert [fault for one in page.evaluate(LOOK) for fault in faults(one)] == []
    page.close()
