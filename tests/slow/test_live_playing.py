# SPDX-License-Identifier: Apache-2.0
"""The live page's pause, steps and speed, in a real browser."""

import time
from pathlib import Path

import pytest

from recordings import plate
from watched import FedCamera, plate_session, reached, session_on, until

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
pytest.importorskip("selenium")

from selenium.webdriver.common.keys import Keys

from test_live_page import page_on

pytestmark = pytest.mark.slow


def test_a_file_shows_its_place_and_goes_by_steps_and_at_another_speed(tmp_path: Path) -> None:
    with plate_session(tmp_path, 150, pace=True) as session, page_on(session, tmp_path) as page:
        page.reads("#status", "Object found")
        page.press(Keys.ENTER)
        page.wait(lambda: page.find("#step").is_enabled())  # which the key asks, too
        page.press(".")
        page.reads("#paused", "paused")
        here = until(session, lambda s: s.paused).image
        page.wait(lambda: page.text("#place-now") == f"{session.shown.image} of 150")
        time.sleep(0.3)
        here = session.shown.image
        page.find("#step").click()
        assert until(session, lambda s: s.image > here).image == here + 1
        time.sleep(0.2)
        assert session.shown.image == here + 1 and session.shown.paused
        page.browser.execute_script(
            "const s = document.getElementById('speed'); s.value = '4'; s.dispatchEvent(new Event('change'))"
        )
        assert until(session, lambda s: s.speed == 4.0)
        page.find("#pause").click()
        reached(session, "ended", image=150)
        page.wait(lambda: page.text("#place-now") == "150 of 150")


def test_a_tool_that_stops_the_images_says_so(tmp_path: Path) -> None:
    camera = FedCamera()
    with session_on(camera, tmp_path / "run", at_once=True) as session, page_on(session, tmp_path) as page:
        camera.images.put(plate())
        reached(session, "tracking", image=1)
        page.wait(lambda: not page.find("#timeline").is_displayed())
        page.press("f")
        page.reads("#hint", "Paused meanwhile.")
