# SPDX-License-Identifier: Apache-2.0
"""The page whose reader drags the paper's transfers gives the answers of the Python that holds to the letter."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from browsers import browser_of
from grasptrack.errors import GraspTrackError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack_bench.baselines.literal import PAPER, LiteralHomography
from research.paper.dragging import DRAGGED, dragged_part, dragged_view
from research.paper.footage import in_four_dof, sample_view

pytestmark = pytest.mark.slow
DOCS = Path(__file__).resolve().parents[2] / "docs"
SETTINGS = 40
"""Drawn from all that the sliders allow, for each outline: half without noise, half begun near the first view's beginning."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    folder = tmp_path_factory.mktemp("page")
    scripts = "".join(
        f'<script src="{(DOCS / name).as_uri()}"></script>' for name in ("transfers-data.js", "transfers.js")
    )
    (folder / "page.html").write_text(f'<!doctype html><meta charset="utf-8"><div id="transfers"></div>{scripts}')
    with browser_of(folder / "profile") as opened:
        opened.get((folder / "page.html").as_uri())
        yield opened
        assert opened.get_log("browser") == []


def as_view(contours: list[list[list[float]]]) -> View:
    return View([Contour.trusted(np.array(points), hole=i > 0) for i, points in enumerate(contours)])


@pytest.mark.parametrize("name", DRAGGED)
def test_it_answers_as_python_does(browser: Any, name: str) -> None:
    rng = np.random.default_rng(DRAGGED.index(name))
    curves, contacts = dragged_part(name)
    front = dragged_view()
    exact = [apply_homography(front, curve) for curve in curves]
    reference, grasp = sample_view(tuple(exact)), Grasp(apply_homography(front, contacts))
    told: list[str] = []
    for k in range(SETTINGS):
        tilt, turn, azimuth = rng.uniform(0.0, 60.0), *rng.uniform(-180.0, 180.0, 2)
        scale, start, noise = (
            rng.uniform(0.5, 1.5),
            rng.uniform(-1.0, 1.0) * (150.0 if k % 4 > 1 else 15.0),
            rng.uniform(0.0, 2.0) * (k % 2),
        )
        given = {"tilt": tilt, "azimuth": azimuth, "turn": turn, "scale": scale, "start": start, "noise": noise}
        found = browser.execute_script("return showTransfers(arguments[0])", {"part": name, **given})
        to_image = dragged_view(tilt, azimuth, turn, scale)
        seen = sample_view(
            tuple(apply_homography(to_image, curve) for curve in curves), np.array([start, *[0.0] * (len(curves) - 1)])
        )
        tracked = in_four_dof(reference, [to_image @ np.linalg.inv(front)])[0]
        first, second = as_view(found["first"]), as_view(found["second"])
        assert np.allclose(first.points, reference.points, atol=1e-6)
        assert np.allclose(as_view(found["tracked"]).points, tracked.points, atol=1e-6)
        assert noise or np.allclose(second.points, seen.points, atol=1e-6)
        assert np.allclose(found["truth"], apply_homography(to_image, contacts), atol=1e-6)
        for strategy, letter in PAPER.items():
            answer = found["answers"][strategy.removeprefix("paper-")]
            try:
                view, description = tracked if strategy == "paper-rrp" else second, letter.describe(grasp, first)
                if isinstance(letter, LiteralHomography):
                    assert answer["peaks"] == description.samples, given
                    assert answer["matched"] == letter.matches(description, view.outer, None)[1].tolist(), given
                moved = letter.apply(description, view)
            except GraspTrackError as reason:
                assert answer["reason"] == str(reason), given
                told.append(str(reason))
            else:
                assert np.abs(np.array(answer["contacts"]) - moved.grasp.contacts).max() < 0.01, given
    assert len(told) < 2 * SETTINGS


def test_sliders_and_a_drag_move_the_second_view(browser: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    def slider(name: str) -> Any:
        return browser.find_element("css selector", f"input[name={name}]")

    browser.execute_script(
        "showTransfers({part: 'bracket', tilt: 20, azimuth: 30, turn: 10, scale: 1, start: 0, noise: 0})"
    )
    before = browser.find_element("css selector", "tr.rrp").text
    slider("tilt").send_keys(Keys.ARROW_RIGHT)
    assert slider("tilt").get_attribute("value") == "21"
    assert browser.find_element("css selector", "tr.rrp").text != before
    view = browser.find_elements("css selector", "#transfers .views svg")[1]
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", view)
    for begin in ((0, 0), (60, -40)):
        tilt, azimuth = slider("tilt").get_attribute("value"), slider("azimuth").get_attribute("value")
        ActionChains(browser).move_to_element_with_offset(view, *begin).click_and_hold().move_by_offset(
            40, 30
        ).release().perform()
        assert (slider("tilt").get_attribute("value"), slider("azimuth").get_attribute("value")) != (tilt, azimuth)
    dot = browser.find_elements("css selector", "#transfers .start")[1]
    ActionChains(browser).move_to_element(dot).click_and_hold().move_by_offset(30, 30).release().perform()
    assert float(slider("start").get_attribute("value")) != 0.0


def test_two_fingers_turn_and_bring_nearer(browser: Any) -> None:
    browser.execute_script("showTransfers({turn: 10, scale: 1})")
    view = browser.find_elements("css selector", "#transfers .views svg")[1]
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", view)
    box = browser.execute_script(
        "const b = arguments[0].getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]", view
    )
    for kind, reach in (("touchStart", (30.0, 0.0)), ("touchMove", (30.0, 30.0)), ("touchEnd", None)):
        touches = (
            [{"x": box[0] + s * reach[0], "y": box[1] + s * reach[1], "id": s + 1} for s in (-1, 1)] if reach else []
        )
        browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})
    turn, scale = (
        float(browser.find_element("css selector", f"input[name={n}]").get_attribute("value"))
        for n in ("turn", "scale")
    )
    assert turn == pytest.approx(55.0, abs=2.0) and scale == pytest.approx(1.41, abs=0.03)


@pytest.mark.parametrize("name", ["transfers", "transfers-data"])
def test_it_fetches_nothing(name: str) -> None:
    script = (DOCS / f"{name}.js").read_text(encoding="utf-8")
    assert not any(word in script.replace("http://www.w3.org/2000/svg", "") for word in ("http", "fetch(", "import "))
