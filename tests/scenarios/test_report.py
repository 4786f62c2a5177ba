# SPDX-License-Identifier: Apache-2.0
"""Pages that a browser takes as they are: well-formed, self-contained, nothing undefined, nothing that is no number."""

import base64
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from grasptrack_bench.metrics.integrity import Measures
from grasptrack_bench.metrics.summary import MethodRow, summarise_run
from grasptrack_bench.report.comparison import compare_runs
from grasptrack_bench.report.comparison_page import write_comparison
from grasptrack_bench.report.glossary import COMPARED, CURVES, TERMS
from grasptrack_bench.report.run import write_report
from grasptrack_bench.report.tables import ANSWERS, ERRORS
from grasptrack_bench.run_folder import read_run
from reported import METHODS, changed, lost, real, scenes
from research.paper.page import paper_report


class Reader(HTMLParser):
    """Reads a page: every tag must be closed in order; collects addresses, ids, words and attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.tags.append((tag, found))
        assert len(found) == len(attrs), f"an attribute twice in {tag}"
        self.ids += [v for k, v in attrs if k == "id" and v]
        self.addresses += [v for k, v in attrs if k in ("src", "href", "xlink:href", "action", "data") and v]
        if tag not in ("meta", "br", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in ("meta", "br", "img"):
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, f"</{tag}> after {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("style", "script"):
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(self.words)


def good(path: Path) -> Reader:
    """The page, after all that holds for any page."""
    source = path.read_text(encoding="utf-8")
    page = Reader(source)
    assert len(page.ids) == len(set(page.ids))
    for address in page.addresses:
        assert address.startswith(("#", "data:image/")), address
        assert not address.startswith("#") or address[1:] in page.ids
    assert "@import" not in source and "url(" not in source and "//fonts" not in source
    assert re.findall(r"https?://(?!www\.w3\.org/2000/svg)\S+", source) == []
    assert not re.search(r"\bnan\b|\binf\b|\bNone\b", re.sub(r"<script>.*?</script>", "", source, flags=re.DOTALL))
    for tag, attributes in page.tags:
        if tag == "img":
            assert attributes.get("alt") and attributes.get("width") and attributes.get("height")
        if tag == "th":
            assert attributes.get("scope") in ("row", "col")
        if tag == "svg":
            assert attributes.get("aria-hidden") == "true" or (
                attributes.get("role") == "img" and attributes["aria-label"]
            )
    return page


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scenes(tmp_path_factory.mktemp("runs") / "a")


def picture(case: str, method: str, frame: int) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]] | None:
    if frame % 5 == 0:
        return None
    image = np.random.default_rng(frame).integers(0, 255, (60, 80), dtype=np.uint8)
    outline = [np.array([[5.0, 15.0], [65.0, 15.0], [65.0, 45.0], [5.0, 45.0]])]
    return image, np.array([[10.0, 20.0], [60.5, 40.25]]), outline


def test_the_page_of_a_run(folder: Path) -> None:
    steps: list[tuple[str, int, int]] = []
    path = write_report(folder, picture=picture, progress=lambda *step: steps.append(step))
    page = good(path)
    assert path == folder / "report.html" and path.stat().st_size < 2_000_000
    for term in TERMS.values():
        assert term.meaning in page.text
    for _, meaning, _ in CURVES:
        assert meaning in page.text
    for key in (*ANSWERS, *ERRORS):
        assert any(tag == "th" and a.get("title") == TERMS[key].meaning for tag, a in page.tags), key
    assert "grasptrack evaluate scenes --output here" in page.text and "a machine, 2 cores" in page.text
    assert "rule of three" in page.text.lower() and "only" in page.text and '<"it">' in page.text
    assert any(tag == "img" for tag, _ in page.tags)
    assert page.text.count("In weight: the best of a column.") == 1
    assert {step for step, _, _ in steps} == {"charts", "worst frames"}
    assert all(0 < done <= total for _, done, total in steps)
    keys = [a["data-key"] for tag, a in page.tags if "data-key" in a]
    assert keys == list(METHODS)


def test_every_measure_is_defined_and_shown() -> None:
    names = set(Measures.__dataclass_fields__) | {
        n for n in MethodRow.__dataclass_fields__ if n in ("located", "risk_area")
    }
    assert set(TERMS) == names
    assert set(ANSWERS) | set(ERRORS) | {"located"} == names
    assert all(t.meaning.endswith(".") and t.label for t in (*TERMS.values(), *COMPARED.values()))


def test_figures_stand_alone(folder: Path) -> None:
    write_report(folder)
    files = sorted((folder / "figures").iterdir())
    assert len(files) == 2 * 3 + 6
    for path in files:
        text = path.read_text(encoding="utf-8")
        root = ElementTree.fromstring(text)
        assert root.tag.endswith("svg") and "var(" not in text and "nan" not in text
    assert "risk-coverage.svg" in [p.name for p in files]


def test_a_run_without_a_wrong_answer_says_how_little_that_proves(tmp_path: Path) -> None:
    right = changed(
        scenes(tmp_path / "a"),
        tmp_path / "b",
        "auto",
        lambda f: lost(f) if f.distances is None or f.distances.max() > f.limit or f.gone else f,
    )
    text = " ".join(good(write_report(right)).text.split())
    assert "never wrong" in text
    frames = 5 * 3 * 29
    assert f"in {frames} measured frames, which puts the rate of wrong answers below {300 / frames:.2f} %" in text


def test_counts_agree(folder: Path, tmp_path: Path) -> None:
    text = " ".join(good(write_report(folder)).text.split())
    assert (
        f"{len(METHODS)} methods were shown the same 450 images: 5 parts under 3 disturbances, 15 sequences in all"
        in text
    )
    summary = summarise_run(read_run(folder))
    for row in summary.overall:
        measured = row.measures.frames
        assert measured == 450 - 15
        without = sum(n for _, n in summary.reasons[row.method])
        answered = sum(f.answered for run in read_run(folder).runs(row.method, read_run(folder).scored) for f in run)
        assert without + answered == 450
        assert f"{without} of {measured} measured frames without contacts" in text
    one = " ".join(good(write_report(scenes(tmp_path / "a", shapes=("disc",)))).text.split())
    assert "1 part under 3 disturbances, 3 sequences in all" in one


def test_a_method_that_never_answers_leaves_dashes(tmp_path: Path) -> None:
    mute = changed(scenes(tmp_path / "a", shapes=("disc",)), tmp_path / "b", "auto", lost)
    page = good(write_report(mute))
    assert "–" in page.text and "No contact of it could be held against a truth." in page.text


def test_the_page_of_videos(tmp_path: Path) -> None:
    page = good(write_report(real(tmp_path / "r"), picture=picture))
    assert "2 real videos" in page.text and "By video" in page.text and "By part" not in page.text
    assert "homographies" in page.text
    for videos in (("film",), ("a", "b", "c")):
        good(write_report(real(tmp_path / videos[0], videos)))


def test_the_page_of_a_comparison(folder: Path, tmp_path: Path) -> None:
    after = changed(folder, tmp_path / "b", "auto", lost, where="bar")
    page = good(write_comparison(compare_runs(folder, after), tmp_path / "compare.html"))
    assert "Worse" in page.text and "located, whole, %" in page.text and "Sequences to look at" in page.text
    same = good(write_comparison(compare_runs(folder, folder), tmp_path / "same.html"))
    assert "Nothing got worse beyond its noise." in same.text
    for term in COMPARED.values():
        assert term.meaning in page.text and term.meaning in same.text


def test_the_page_of_the_papers_tables(tmp_path: Path) -> None:
    table = SimpleNamespace(
        number="IV", title="A title", head=("grasp", "d_1"), rows=(("a <b>", 0.25), ("c", None)), notes=("A note.",)
    )
    errors = (0.5, None, 0.25, 1e-14, 0.0)
    series = [
        SimpleNamespace(
            footage=SimpleNamespace(part=SimpleNamespace(name=o), kind=k, motion="4 DoF"),
            strategy=s,
            way="first view",
            errors_px=lambda _: errors,
        )
        for o in ("bracket", "blob")
        for s in ("rrp", "snake")
        for k in ("ideal", "rendered")
    ]
    shown = [("A caption\nand more", np.zeros((20, 30, 3), np.uint8))]
    page = good(paper_report(tmp_path, [table], series, shown, lead="In **short**.", facts=[("Machine", "one")]))
    for text in ("Table IV.", "A title", "a <b>", "0.250", "A note.", "A caption", "and more", "In ", "short", "80.0"):
        assert text in page.text
    assert len(list((tmp_path / "figures").iterdir())) == 4 + 2
    good(paper_report(tmp_path, [table]))


def test_pictures_come_back_from_the_page(tmp_path: Path) -> None:
    picture = np.zeros((40, 50, 3), np.uint8)
    picture[:, 25:] = (10, 200, 90)
    page = good(paper_report(tmp_path, [], [], [("flat", picture)]))
    address = next(a["src"] for tag, a in page.tags if tag == "img")
    assert address is not None and address.startswith("data:image/png;base64,")
    data = np.frombuffer(base64.b64decode(address.split(",")[1]), np.uint8)
    assert np.array_equal(cv2.imdecode(data, cv2.IMREAD_COLOR), picture)
    assert not math.isnan(float(picture.mean()))
