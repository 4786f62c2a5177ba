# SPDX-License-Identifier: Apache-2.0
"""Laws of the tracker: what must not matter does not, what is refused has a code, what is given fits together."""

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import pytest

from grasptrack.errors import GraspError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.closure_probability import CHANCE
from grasptrack.grasp.contacts import Grasp
from grasptrack.tracking.decision import CODES, NOTHING, check_strategy_contacts
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.initialization import count_describing_strategies, synthesize_grasps
from grasptrack.tracking.messages import FIGURES, SENTENCES, StatusReason
from grasptrack.tracking.pose import PoseEstimate
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.transfer import STRATEGIES
from grasptrack_bench.simulation import SHAPES, plain_texture
from stages import HEIGHT, WIDTH, bar, mirrored, photo, pose

BRACKET = SHAPES["bracket"]()
POSES = [pose(150.0 + 3 * k, 115.0 + 2 * k, 3.0 * k) for k in range(6)]
IMAGES = [photo([(BRACKET, H)], seed=k) for k, H in enumerate(POSES)]
GIVEN = [[215.0, 110.0], [104.5, 113.3]]
ALL = ("auto", "paper", *STRATEGIES)


def track(
    images: Sequence[np.ndarray], times: Sequence[float | None] | None = None, **options: object
) -> list[TrackResult]:
    tracker = GraspTracker(**options)  # type: ignore[arg-type]
    return [tracker.update(image, time) for image, time in zip(images, times or [None] * len(images), strict=True)]


def contacts(results: Sequence[TrackResult]) -> np.ndarray:
    assert all(r.contacts is not None for r in results), [r.reason for r in results]
    return np.array([r.contacts for r in results])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("strategy", ALL)
def test_what_is_shifted_by_whole_px_is_answered_as_much_farther(strategy: str) -> None:
    dx, dy = 16, 8
    first = track([image[:-dy, :-dx] for image in IMAGES], grasp=GIVEN, strategy=strategy)
    there = np.array(GIVEN) - (dx, dy)
    second = track([image[dy:, dx:] for image in IMAGES], grasp=there, strategy=strategy)
    apart = contacts(first) - contacts(second) - (dx, dy)
    assert np.abs(apart).max() < 0.1


def belt(count: int, step: float = 9.0, gap: float = 330.0) -> list[np.ndarray]:
    """Two parts that come in from the left and leave to the right, one after the other."""
    spanner = SHAPES["spanner"]()
    return [
        photo([(BRACKET, pose(x, 120.0, 10.0)), (spanner, pose(x - gap, 110.0, -20.0))], seed=k)
        for k, x in enumerate(step * np.arange(count) - 60.0)
    ]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("strategy", ["auto", "rrp"])
def test_parts_on_a_belt_have_a_number_each_from_where_they_lie_whole(strategy: str) -> None:
    results = track(belt(66), strategy=strategy, wait=True, next_object=True)
    assert {r.reason_code for r in results if r.status == "searching"} == {"no-object", "waiting"}
    for number in (1, 2):
        mine = [r for r in results if r.grasp_id == number]
        first = mine[0].view
        assert first is not None and not first.is_clipped and mine[0].object_sure
        assert [r.frame for r in mine] == list(range(mine[0].frame, mine[0].frame + len(mine)))
        assert sum(r.located for r in mine) > 8
    assert max(r.grasp_id or 0 for r in results) == 2


def test_without_it_one_part_is_meant_to_the_end() -> None:
    results = track(belt(66)[20:])
    assert {r.grasp_id for r in results} == {1} and not any(r.located for r in results[-8:])


@pytest.mark.parametrize("hidden", ["covered", "blurred"])
def test_a_part_that_is_hidden_in_plain_view_is_not_given_up(hidden: str) -> None:
    seen = belt(30)[18:]
    hide = {
        "covered": lambda image: cv2.rectangle(image.copy(), (90, 0), (WIDTH, HEIGHT), 90.0, -1),
        "blurred": lambda image: cv2.GaussianBlur(image, (0, 0), 12.0),
    }[hidden]
    lost = [hide(image) for image in seen[6:]]
    results = track([*seen[:6], *lost], next_object=True)
    assert {r.grasp_id for r in results} == {1} and not results[-1].located


def test_who_waits_takes_what_is_said_of_a_part_that_comes() -> None:
    empty = [photo([], seed=k) for k in (90, 91)]
    for said in ({"object_at": (150, 110)}, {"grasp": GIVEN}, {"number": 1}, {"mask": True}):
        mask = said.pop("mask", None)
        tracker = GraspTracker(wait=True, **said)  # type: ignore[arg-type]
        results = [
            tracker.update(image, mask=(image < 100).astype(np.uint8) if mask else None)
            for image in [*empty, *IMAGES[:2]]
        ]
        assert [r.status for r in results] == ["searching"] * 2 + ["tracked"] * 2


@pytest.mark.sampled(1)
@pytest.mark.parametrize("strategy", ALL)
def test_the_order_of_the_contacts_is_that_of_the_grasp(strategy: str) -> None:
    forth = contacts(track(IMAGES, grasp=GIVEN, strategy=strategy))
    back = contacts(track(IMAGES, grasp=GIVEN[::-1], strategy=strategy))
    assert np.abs(forth - back[:, ::-1]).max() < 0.05
    assert np.abs(forth - back).max() > 50.0


@pytest.mark.parametrize("times", [[0.1 * k for k in range(5)], [0.0, 0.1, 0.5, 0.6, 2.0], [7.0] * 5])
def test_times_do_not_matter_while_the_object_rests(times: list[float]) -> None:
    images = [photo([(BRACKET, POSES[0])], seed=k) for k in range(5)]
    timed, untimed = track(images, times, grasp=GIVEN), track(images, grasp=GIVEN)
    assert [r.time for r in timed] == times
    assert np.abs(contacts(timed) - contacts(untimed)).max() < 0.05


def test_what_lies_under_an_ignored_pixel_does_not_matter() -> None:
    ignore = np.zeros((HEIGHT, WIDTH), np.uint8)
    ignore[:, 130:150] = 1
    found = []
    for level in (0, 255):
        images = [image.copy() for image in IMAGES]
        for image in images:
            image[ignore != 0] = level
        found.append(contacts(track(images, grasp=GIVEN, ignore=ignore)))
    np.testing.assert_array_equal(found[0], found[1])
    truth = [apply_homography(H @ np.linalg.inv(POSES[0]), found[0][0]) for H in POSES]
    assert np.abs(found[0] - np.array(truth)).max() < 1.0


@pytest.mark.parametrize("strategy", ALL)
def test_a_mirrored_object_is_refused(strategy: str) -> None:
    wrong = [photo([(mirrored(BRACKET), H)], seed=k) for k, H in enumerate(POSES[3:])]
    results = track([*IMAGES[:3], *wrong], strategy=strategy)
    assert [r.status for r in results] == ["tracked"] * 3 + ["lost"] * 3
    assert all(r.reason_code in SENTENCES and r.reason for r in results[3:])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("strategy", ALL)
def test_an_image_of_nothing_is_lost_with_a_code(strategy: str) -> None:
    blank = np.full((HEIGHT, WIDTH), 128, np.uint8)
    results = track([*IMAGES[:3], blank, photo([]), *IMAGES[3:]], strategy=strategy)
    assert [r.status for r in results] == ["tracked"] * 3 + ["lost"] * 2 + ["tracked"] * 3
    for r in results:
        assert bool(r.reason_code) == bool(r.reason) == (r.status != "tracked" or r.chance < CHANCE)
    for r in results[3:5]:
        assert r.reason_code in CODES or r.reason_code == "no-transfer"
        assert (r.contacts, r.seen, r.covariance, r.homography) == (None, None, None, None)
        assert 0.0 <= r.confidence < 0.01 and r.grasp_id == 1


def closing_with(room: float) -> dict[str, object]:
    """Options under which the grasp closes with so many rad of its friction angle to spare."""
    (start,) = track(IMAGES[:1], grasp=GIVEN)
    assert start.analysis is not None
    return {"grasp": GIVEN, "friction": math.tan(math.atan(0.5) - start.analysis.margin + room)}


@pytest.mark.parametrize(
    ("images", "options", "status", "code"),
    [
        ([photo([])], dict, "searching", "no-object"),
        ([np.zeros((HEIGHT, WIDTH), np.uint8)], dict, "searching", "no-object"),
        ([np.full((HEIGHT, WIDTH), 255, np.uint8)], dict, "searching", "no-object"),
        (IMAGES[:1], lambda: {"friction": 1e-6}, "searching", "no-grasp"),
        (IMAGES[:1], lambda: {"choose": lambda view: []}, "searching", "no-grasp"),
        ([photo([(SHAPES["disc"](), pose())])], lambda: {"strategy": "grasp-line"}, "searching", "no-description"),
        (IMAGES[:2], lambda: closing_with(-0.01), "unstable", "not-closing"),
        (IMAGES[:2], lambda: closing_with(2e-4), "unstable", "slips"),
    ],
    ids=["nothing", "black", "white", "no-friction", "no-choice", "disc", "loose", "slippery"],
)
def test_each_refusal_has_its_code(
    images: list[np.ndarray], options: Callable[[], dict[str, object]], status: str, code: str
) -> None:
    result = track(images, **options())[-1]
    assert (result.status, result.reason_code) == (status, code)
    assert result.reason and (result.contacts is None) == (status == "searching")


def test_the_object_that_needs_a_grasp_may_be_gone() -> None:
    results = track([*IMAGES[:2], photo([]), photo([(BRACKET, pose(60.0, 60.0, scale=25.0))])],
                    **closing_with(-0.01), resynthesize=True)  # fmt: skip
    assert [r.reason_code for r in results] == ["not-closing", "not-closing", "no-object", "object-gone"]


def test_every_code_has_a_sentence() -> None:
    assert set(CODES) <= SENTENCES.keys()
    for code in SENTENCES:
        assert StatusReason(code, detail="details").sentence
    assert all(StatusReason(code).sentence for code in CODES)
    assert StatusReason().sentence == ""
    told = StatusReason("uncertain", {"sigma": 4.2, "tolerance": 3.0, "probability_off": 0.3}).sentence
    assert "4.2 px" in told and "3.0 px" in told and "0.3" not in told
    assert all(text.format(0.5) for text in FIGURES.values())


def test_a_hidden_contact_is_located_and_not_called_seen() -> None:
    start, *_ = contacts(track(IMAGES[:1], grasp=GIVEN))
    x, y = start[1]
    cover = np.array([[x - 12, y - 12], [x + 12, y - 12], [x + 12, y + 12], [x - 12, y + 12]])
    images = [photo([(BRACKET, POSES[0])], seed=0), *(photo([(BRACKET, POSES[0])], [(cover, 120.0)]) for _ in range(2))]
    for r in track(images, grasp=GIVEN)[1:]:
        assert r.contacts is not None and r.seen is not None, r.reason
        assert r.seen[1] < 0.1 and r.seen[0] > 0.9
        assert np.abs(r.contacts - start).max() < 1.0


def test_all_that_is_given_fits_together() -> None:
    results = track(IMAGES, grasp=GIVEN)
    first = results[0]
    assert first.contacts is not None and first.view is not None and first.confidence == 1.0
    for r in results[1:]:
        assert r.contacts is not None and r.homography is not None and r.view is not None
        assert r.covariance is not None and r.homography_covariance is not None and r.analysis is not None
        assert np.allclose(apply_homography(r.homography, first.contacts), r.contacts, atol=1e-6)
        assert np.allclose(apply_homography(r.homography, first.view.outer.points), r.view.outer.points, atol=1e-6)
        for contact, covariance in zip(first.contacts, r.covariance, strict=True):
            J = np.array(
                [
                    apply_homography(r.homography + 1e-7 * E, contact[None])[0]
                    - apply_homography(r.homography - 1e-7 * E, contact[None])[0]
                    for E in np.eye(9).reshape(9, 3, 3)[:8]
                ]
            ).T / 2e-7  # fmt: skip
            assert np.allclose(J @ r.homography_covariance[:8, :8] @ J.T, covariance, rtol=0.02)
        assert abs(r.analysis.margin - first.analysis.margin) < 2.0 * r.margin_sd  # type: ignore[union-attr]
        assert r.rectification is not None and 0.0 <= r.tilt < 3.0 * r.tilt_sd


@pytest.mark.sampled(1)
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_strategys_own_contacts_are_the_answer(strategy: str) -> None:
    own, others = track(IMAGES, grasp=GIVEN, strategy=strategy), track(IMAGES, grasp=GIVEN)
    apart = np.abs(contacts(own[1:]) - contacts(others[1:]))
    assert 0.0 < apart.max() < 1.0
    assert {r.strategy for r in own} == {strategy}
    assert {r.strategy for r in others} == {"registration"}
    for r in own[1:]:
        assert r.covariance is not None and (np.linalg.eigvalsh(r.covariance) > 0.0).all()


def test_contacts_that_a_strategy_puts_elsewhere_are_not_given_out() -> None:
    start, *_ = track(IMAGES[:1], grasp=GIVEN)
    assert start.view is not None and start.contacts is not None
    follower = Follower(IMAGES[0], start.view, start.contacts)
    decision = follower.update(IMAGES[1])
    estimate = decision.estimate
    assert isinstance(estimate, PoseEstimate) and decision.is_accepted
    off = [check_strategy_contacts(decision, estimate.contacts + np.array([d, 0.0])) for d in (0.0, 0.5, 1.0, 10.0)]
    assert off[0].probability_off == pytest.approx(decision.probability_off)
    risks = [d.probability_off for d in off]
    assert risks == sorted(risks) and risks[-1] == 1.0
    assert [d.is_accepted for d in off[:1]] == [True] and off[-1].code == "strategy-off"
    assert off[-1].figures["distance"] == pytest.approx(10.0)
    assert check_strategy_contacts(NOTHING, estimate.contacts).code == "not-found"


def test_a_bar_across_leaves_strategies_nothing_wrong() -> None:
    for strategy in STRATEGIES:
        tracker = GraspTracker(strategy=strategy, grasp=GIVEN)
        start = tracker.update(IMAGES[0]).contacts
        assert start is not None
        found = 0
        for k, x in enumerate(range(40, 280, 20)):
            r = tracker.update(photo([(BRACKET, POSES[0])], [(bar(float(x), 24.0), 150.0)], seed=k))
            if r.contacts is not None:
                assert np.hypot(*(r.contacts - start).T).max() < 3.0
                found += 1
        assert found >= 4


def test_of_nearly_as_good_grasps_the_one_is_taken_that_most_strategies_can_carry() -> None:
    (start,) = track([photo([(BRACKET, POSES[0])], ground=plain_texture(2))])
    assert start.view is not None and start.contacts is not None
    ranked, reason = synthesize_grasps(start.view, "auto", 2, 0.5, None, [])
    assert reason == "" and np.array_equal(ranked[0].contacts, start.contacts)
    best = max(g.quality for g in ranked)
    good = [g for g in ranked if g.quality >= 0.7 * best]
    assert ranked[: len(good)] == good
    counts = [count_describing_strategies(g, start.view) for g in good]
    assert counts == sorted(counts, reverse=True) and counts[0] == 2
    assert len(synthesize_grasps(start.view, "rrp", 2, 0.5, None, [])[0]) >= len(ranked)


def test_a_choice_of_another_number_of_fingers_is_an_error() -> None:
    with pytest.raises(GraspError, match="2 contacts"):
        track(IMAGES[:1], choose=lambda view: [Grasp(view.outer.points[::40][:3])])
