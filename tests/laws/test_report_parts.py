# SPDX-License-Identifier: Apache-2.0
"""Axes, charts, numbers and pictures of reports against their laws."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.cli.advice import MANY, MOST, advice_for
from grasptrack.live.state import OPTIONS
from grasptrack.presentation import REMEDIES
from grasptrack.tracking.messages import SENTENCES
from grasptrack_bench.charts import DASH, Axis, Chart, format_number, format_percent, series_palette
from grasptrack_bench.charts.answer import TRUE_RGB, WRONG_RGB, draw_answer
from grasptrack_bench.charts.chart import linear_ticks, log_range
from grasptrack_bench.charts.palette import format_fixed
from grasptrack_bench.metrics.integrity import out_of_view, over_time, precision_curve, recovery_curve
from grasptrack_bench.report.pages import cell_of
from grasptrack_bench.report.table import Table
from reported import made_up
from research.paper.page import paper_report
from research.studies.reason_pictures import SHOWN, STAGED, first_frame_with

FLOATS = st.floats(allow_nan=True, allow_infinity=True)
SIZES = st.floats(1e-6, 1e6)


@given(FLOATS)
def test_any_number_is_written_without_a_word(value: float) -> None:
    for text in (
        format_number(value),
        format_fixed(value, 3),
        format_percent(value if 0.0 <= value <= 1.0 else math.nan),
        cell_of(value).text,
    ):
        assert ("nan" not in text and "inf" not in text and "e+" not in text.replace("e+", "", 0)) or abs(value) > 1e6
    assert (format_number(value) == DASH) == math.isnan(value)


@given(st.floats(0.0, 1.0), st.integers(1, 3))
def test_only_all_is_written_as_a_hundred_per_cent_and_only_none_as_zero(share: float, decimals: int) -> None:
    text = format_percent(share, decimals)
    assert (float(text) == 100.0) == (share == 1.0)
    assert (float(text) == 0.0) == (share == 0.0)
    assert float(text) == pytest.approx(100.0 * share, abs=1.01 * 10.0**-decimals)


@given(
    SIZES, st.floats(1.01, 1e4), st.sampled_from(["linear", "log", "root"]), st.lists(st.floats(0.0, 1.0), min_size=2)
)
def test_an_axis_keeps_order_and_its_ends(low: float, ratio: float, kind: str, shares: list[float]) -> None:
    axis = Axis("", low, low * ratio, kind)  # type: ignore[arg-type]
    assert axis.to_fraction([low, low * ratio]) == pytest.approx([0.0, 1.0])
    values = np.sort(low + np.array(shares) * (low * ratio - low))
    places = axis.to_fraction(values)
    assert (np.diff(places) >= 0.0).all() and places.min() >= 0.0 and places.max() <= 1.0
    assert axis.to_fraction([low / 2.0, low * ratio * 2.0]) == pytest.approx([0.0, 1.0])
    assert np.isnan(axis.to_fraction(math.nan))


@given(SIZES, st.floats(1.5, 1e5))
def test_marks_lie_on_the_axis_and_are_few(low: float, ratio: float) -> None:
    high = low * ratio
    for axis in (Axis("", low, high, "log"), Axis("", low, high)):
        assert all(low * 0.998 <= m <= high * 1.002 for m in axis.tick_values)
        assert len(axis.tick_values) <= 9
    assert len(linear_ticks(0.0, high)) >= 3


@given(st.lists(st.one_of(FLOATS, st.just(0.0)), max_size=20))
def test_a_range_holds_what_it_can(values: list[float]) -> None:
    low, high = log_range(values, 1e-3, 1e3, floor=10.0)
    assert 1e-3 * 0.999 <= low < high <= 1e3 * 10.01 and high >= low * 1.99
    inside = [v for v in values if 1e-3 <= v <= 1e3]
    assert all(low * 0.999 <= v <= high * 1.001 for v in inside)


def test_a_line_breaks_where_there_is_no_value() -> None:
    series = series_palette(["auto"])["auto"]
    chart = Chart("title & more", Axis("x", 0.0, 10.0), Axis("y", 0.0, 1.0))
    chart.draw_line([0, 1, 2, 3, 4], [0.1, 0.2, math.nan, 0.3, math.nan], series)
    chart.draw_band([0, 1, 2, 3], [0.1, 0.1, math.nan, 0.1], [0.2, 0.2, 0.2, 0.3], series)
    chart.draw_dot(math.nan, 1.0, series)
    svg = chart.svg()
    path = re.search(r'class="ln"[^>]* d="([^"]*)"', svg)
    assert path is not None and path[1].count("M") == 2
    assert "nan" not in svg and "title &amp; more" in svg and "<circle" not in svg


def test_every_method_has_a_line_of_its_own() -> None:
    names = [
        "auto", "rrp", "grasp-line", "homography", "ecc", "klt", "sift", "otsu", "visp", "paper-rrp", "new", "newer",
    ]  # fmt: skip
    found = series_palette(names)
    assert list(found) == names
    assert len({(s.light, s.dash) for s in found.values()}) == len(names)
    assert len({s.variable for s in found.values()}) == len(names)
    assert series_palette(["ecc"])["ecc"] == found["ecc"]


def test_what_stands_in_a_page_is_escaped(tmp_path: Path) -> None:
    table = Table("<IV>", "`a<b`", ("<i>", "n"), (("<u>", math.nan), ("**c<d**", None)), ("<note>",))
    pictures = [("<caption>\n<more>", np.zeros((4, 5), np.uint8))]
    page = paper_report(tmp_path, [table], (), pictures, title="<script>alert(1)</script>", lead="x < y & z")
    text = page.read_text(encoding="utf-8")
    for raw in ("<script>alert", "<IV>", "<i>", "<u>", "<note>", "<caption>", "<more>", "x < y"):
        assert raw not in text
    assert "<code>a&lt;b</code>" in text and "<strong>c&lt;d</strong>" in text and "x &lt; y &amp; z" in text


def test_error_over_time_is_the_median_over_the_runs() -> None:
    runs = [made_up(np.random.default_rng(k), "bar", "auto") for k in range(9)]
    found = over_time(runs)
    for i in range(30):
        errors = [r[i].error for r in runs if r[i].distances is not None and not r[i].defining]
        if len(errors) >= 3:
            assert found.median[i] == pytest.approx(float(np.median(errors)))
            assert min(errors) <= found.low[i] <= found.median[i] <= found.high[i] <= max(errors)
        shown = [r[i].answered for r in runs if not r[i].defining]
        assert math.isnan(found.located[i]) if not shown else found.located[i] == pytest.approx(np.mean(shown))
    assert out_of_view(runs) == ([], [(10, 17)])
    assert out_of_view([made_up(np.random.default_rng(0), "away", "auto")]) == ([(10, 17)], [])


def test_precision_counts_frames_without_an_answer_as_missed() -> None:
    runs = [made_up(np.random.default_rng(k), "clean", "ecc") for k in range(4)]
    at = np.array([0.1, 0.5, 1.0, 1e9])
    found = precision_curve(runs, at)
    asked = [f for r in runs for f in r if not f.defining]
    for t, share in zip(at, found, strict=True):
        assert share == pytest.approx(sum(f.distances is not None and f.error <= t for f in asked) / len(asked))
    assert precision_curve(runs, 100.0 * at / 55.0, of_opening=True) == pytest.approx(found)
    assert np.isnan(precision_curve([], at)).all()


def test_shares_recovered_grow_to_all_that_were() -> None:
    runs = [made_up(np.random.default_rng(k), "away", "ecc") for k in range(6)]
    shares, returns = recovery_curve(runs, 11)
    assert returns == 6 and (np.diff(shares) >= 0.0).all() and shares[-1] == 1.0
    blind = [[replace(f, contacts=None, distances=None) if f.frame else f for f in r] for r in runs]
    assert recovery_curve(blind, 11)[0].tolist() == [0.0] * 12


def has(picture: np.ndarray, rgb: tuple[int, int, int]) -> bool:
    return bool((np.abs(picture.astype(int) - rgb[::-1]).sum(axis=2) < 30).any())


@pytest.mark.parametrize("shape", [(480, 640), (480, 640, 3), (40, 30)])
@pytest.mark.parametrize("shift", [0.0, 4.0, 60.0, -5000.0, math.inf])
def test_truth_and_answer_are_both_drawn(shape: tuple[int, ...], shift: float) -> None:
    image = np.full(shape, 90, np.uint8)
    truth = np.array([[10.0, 12.0], [25.0, 30.0]])
    outline = [np.array([[5.0, 5.0], [28.0, 5.0], [28.0, 38.0], [5.0, 38.0]])]
    drawn = draw_answer(image, truth, outline, truth + shift)
    assert drawn.shape == (300, 400, 3) and drawn.dtype == np.uint8
    assert has(drawn, TRUE_RGB)
    near = abs(shift) < 0.2 * max(shape[:2])
    assert has(drawn, WRONG_RGB) == near
    assert (image == 90).all()


def test_an_answer_without_an_object_is_drawn_alone() -> None:
    drawn = draw_answer(np.full((100, 100), 90, np.uint8), None, (), np.array([[20.0, 20.0], [60.0, 60.0]]))
    assert has(drawn, WRONG_RGB) and not has(drawn, TRUE_RGB)
    assert not has(draw_answer(np.full((100, 100), 90, np.uint8), None, (), None), WRONG_RGB)


# --- advice ---------------------------------------------------------------------------------------


PAGE = Path(__file__).resolve().parents[2] / "docs" / "troubleshooting.md"


def test_every_code_has_a_remedy_here_and_on_the_page() -> None:
    assert REMEDIES.keys() == SENTENCES.keys()
    plain = [re.sub(OPTIONS, "", remedy) for remedy in REMEDIES.values()]
    assert [remedy for remedy in plain if "--" in remedy or "FILE" in remedy or ".mp4" in remedy] == []
    rows = [
        [c.strip() for c in line.strip("|").split("|")]
        for line in PAGE.read_text().splitlines()
        if line.startswith("| `")
    ]
    told = {row[0].strip("`"): row for row in rows if row[0].strip("`") in SENTENCES}
    assert told.keys() == SENTENCES.keys()
    for code, (_, meaning, remedy, picture) in told.items():
        assert remedy == REMEDIES[code] and meaning in (SENTENCES[code], meaning if not SENTENCES[code] else "")
        assert picture == (f"![{code}](images/reasons/{code}.webp)" if code in STAGED else "")


def test_every_reason_that_can_be_staged_has_a_small_picture() -> None:
    kept = {path.stem: path.stat().st_size for path in (PAGE.parent / "images" / "reasons").glob("*.webp")}
    assert kept.keys() == STAGED.keys() <= SENTENCES.keys()
    assert sum(kept.values()) < 600_000


@pytest.mark.sampled(1)
@pytest.mark.parametrize("code", ["no-grasp", "no-description", "object-gone"])
def test_a_staged_scene_gives_its_reason(code: str) -> None:
    found = first_frame_with(code)
    assert found is not None
    picture, result = found
    assert result.reason_code == code and picture.shape == (SHOWN[1], SHOWN[0], 3) and picture.std() > 5.0


@given(codes=st.dictionaries(st.sampled_from(sorted(SENTENCES)), st.integers(0, 50)), more=st.integers(0, 500))
def test_advice_names_the_most_frequent_reasons(codes: dict[str, int], more: int) -> None:
    frames = sum(codes.values()) + more
    told = advice_for(codes, frames)
    if sum(codes.values()) <= MANY * frames:
        assert told == []
        return
    assert 0 < len(told) <= MOST or max(codes.values()) <= 0.05 * frames
    if told:
        assert told[0].startswith(f"{max(codes.values())} of {frames} frames")
