# SPDX-License-Identifier: Apache-2.0
"""The button that lets an arm move, in a real browser: held, let go of, and lost with its page."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from browsers import browser_of
from test_servo_page import Served, served

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
selenium = pytest.importorskip("selenium")

from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402

from test_live_page import Page  # noqa: E402

pytestmark = pytest.mark.slow


@contextmanager
def arm_page(folder: Path) -> Iterator[tuple[Page, Served]]:
    """A page whose arm stands, with a goal."""
    with served(folder / "run") as here, browser_of(folder / "profile") as browser:
        browser.get(here.server.url)
        page = Page(browser)
        page.reads("#link", "live")
        page.wait(lambda: page.find("#teach").is_enabled())
        page.press("g")
        page.wait(lambda: page.find("#hold").is_enabled())
        yield page, here
        assert page.complaints() == []


def is_held(here: Served) -> bool:
    return here.desk.switch.is_held(time.perf_counter())


def test_the_arm_may_move_while_the_button_or_the_space_key_is_held(tmp_path: Path) -> None:
    with arm_page(tmp_path) as (page, here):
        hold = page.find("#hold")
        for begin, end in (
            (lambda a: a.click_and_hold(hold), lambda a: a.release()),
            (lambda a: a.key_down(Keys.SPACE), lambda a: a.key_up(Keys.SPACE)),
        ):
            begin(ActionChains(page.browser, duration=20)).perform()
            page.wait(lambda: is_held(here))
            time.sleep(1.0)
            assert is_held(here) and hold.get_attribute("aria-pressed") == "true"
            end(ActionChains(page.browser, duration=20)).perform()
            page.wait(lambda: not is_held(here))
            page.reads("#servo-word", "Stopped")
            page.reads("#servo-why", "let go of")
            assert hold.get_attribute("aria-pressed") == "false"
        assert here.session.shown.phase == "tracking" and not here.session.shown.paused


LOSSES = {
    "lost the focus": "dispatchEvent(new Event('blur'))",
    "was hidden": "Object.defineProperty(document, 'hidden', {value: true}); "
    "document.dispatchEvent(new Event('visibilitychange'))",
    "did not say within": "const end = performance.now() + 600; while (performance.now() < end);",
    "the page": "location.reload()",
}


@pytest.mark.parametrize("told", LOSSES)
def test_a_page_that_is_lost_lets_go_and_says_why(tmp_path: Path, told: str) -> None:
    with arm_page(tmp_path) as (page, here):
        ActionChains(page.browser, duration=20).key_down(Keys.SPACE).perform()
        page.wait(lambda: is_held(here))
        page.browser.execute_script(LOSSES[told])
        page.wait(lambda: here.desk.switch.holder is None)
        assert told in here.desk.switch.why
        if "hidden" not in told:  # a hidden page draws nothing
            page.reads("#servo-why", told)
        time.sleep(0.5)
        assert here.desk.switch.holder is None


def test_a_second_page_says_that_the_first_holds_the_button(tmp_path: Path) -> None:
    with arm_page(tmp_path) as (page, here):
        here.desk.press_switch("another")
        until_ = time.monotonic() + 3.0
        while "another page" not in page.text("#servo-why") and time.monotonic() < until_:
            here.desk.keep_held("another")
            time.sleep(0.05)
        assert "another page holds the button" in page.text("#servo-why")
        assert not page.find("#hold").is_enabled()
