# SPDX-License-Identifier: Apache-2.0
"""Parts taught in one image and found in another: each instance, none that is none, and none that lies turned over."""

import csv
import json
import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.homographies import apply_homography
from grasptrack.segmentation.candidate_search import CandidateSearch
from grasptrack.tracking.estimator import estimate_pose, first_state
from grasptrack.tracking.image_pair import transfer_between_images
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.pose import Hypothesis
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.target import build_pyramid
from grasptrack_bench.approach.picking import TrayRobot, travel
from grasptrack_bench.approach.trays import TrayCase
from grasptrack_bench.simulation import SHAPES
from scenery import L_PLATE, drawn

HOOK = 1.3 * np.array([[-60, -40], [60, -40], [60, 40], [20, 40], [20, -5], [-60, -5]], dtype=np.float64)
ELL = 1.1 * L_PLATE
MIRRORED = ELL[::-1] * np.array([-1.0, 1.0])
DISC = 70.0 * np.column_stack([np.cos(np.arange(0.0, 6.28, 0.1)), np.sin(np.arange(0.0, 6.28, 0.1))])
STAR = 100.0 * SHAPES["star"]().outer
CRESCENT = 130.0 * SHAPES["crescent"]().outer
SIZE = (480, 640)


def turned(outline: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return outline @ np.array([[c, s], [-s, c]])


@cache
def part(name: str = "ell", outline: str = "ELL") -> gt.Part:
    """A part as an image of it alone teaches it."""
    image = drawn(globals()[outline], centres=((160.0, 120.0),), angle=0.0, seed=7)
    view = gt.first_look(image)[0].view
    return gt.Part.of(image, view, gt.synthesize(view, 2, top=2), name=name)


def tray(*placed: tuple[np.ndarray, float, tuple[float, float]]) -> np.ndarray:
    """(H, W) parts on a ground, each turned and at its place."""
    shapes = [turned(outline, angle) for outline, angle, _ in placed]
    return drawn(
        *shapes, centres=tuple(at for *_, at in placed), angle=0.0, size=SIZE, contrast=85.0, noise=2.0, seed=3
    )


THREE = ((ELL, 0.4, (130.0, 120.0)), (ELL, 2.5, (330.0, 330.0)), (ELL, 4.0, (500.0, 130.0)))


def centroid(points: np.ndarray) -> np.ndarray:
    moments = cv2.moments(points.astype(np.float32))
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


def truth(angle: float, at: tuple[float, float]) -> np.ndarray:
    """(k, 2) px of the part's contacts on one that lies turned at a place."""
    return turned(part().grasps[0].contacts - centroid(part().view.outer.points) + centroid(ELL), angle) + at


def test_every_instance_is_found_where_it_lies() -> None:
    found = gt.find(tray(*THREE), part())
    assert [one.found for one in found] == [True] * 3
    for _, angle, at in THREE:
        errors = [np.hypot(*(one.contacts - truth(angle, at)).T).max() for one in found]
        assert min(errors) < 1.0
    for one in found:
        np.testing.assert_allclose(apply_homography(one.homography, part().grasps[0].contacts), one.contacts, atol=1e-6)
        assert one.confidence >= 0.999 and one.edge > 0.9 and (one.seen > 0.5).all() and one.analysis.stable
        assert np.isinf(one.room) and not one.mirrored and one.turns == () and one.covariance.shape == (2, 2, 2)


def test_what_is_explained_leaves_of_what_touches_it_the_rest() -> None:
    """Two squares with a common side are one region; without one of them the other one is."""
    image = np.full(SIZE, 200, np.uint8)
    image[150:300, 150:450] = 60
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    search = CandidateSearch(image, FirstImage().within(SIZE), None)
    assert [round(rough.view.outer.area, -3) for rough in search.rough_outlines()] == [45_000]
    explained = np.zeros(SIZE, np.uint8)
    explained[150:300, 150:300] = 255
    search.leave_out(explained)
    (rest,) = search.rough_outlines()
    assert rest.view.is_clipped and rest.view.outer.points[:, 0].min() == pytest.approx(302, abs=2)
    found = rest.localized_candidate
    assert found is not None and found.view.outer.points[:, 0].max() == pytest.approx(449.5, abs=0.3)


def test_one_part_is_found_where_transfer_has_it() -> None:
    first, image = drawn(ELL, centres=((160.0, 120.0),), angle=0.0, seed=7), tray(THREE[1])
    view = gt.first_look(first)[0].view
    (grasp,) = gt.synthesize(view, 2, top=1)
    (one,) = gt.find(image, gt.Part.of(first, view, [grasp], name="ell"))
    pair = transfer_between_images(grasp, view, first, image, 0.5)
    assert pair.outcomes[0].reason == ""
    np.testing.assert_allclose(one.contacts, pair.outcomes[0].contacts, atol=0.02)


def test_what_a_part_keeps_of_a_search_changes_no_answer() -> None:
    own, image = part.__wrapped__(), tray(*THREE, (MIRRORED, 1.0, (320.0, 120.0)))
    answers = [gt.find(image, own, risk=risk) for risk in (1e-3, 1e-3, 0.2, 1e-3)]
    fresh = [gt.find(image, part.__wrapped__(), risk=risk) for risk in (1e-3, 0.2)]
    assert answers == [fresh[0], fresh[0], fresh[1], fresh[0]] and len(fresh[0]) == 4
    again = pickle.loads(pickle.dumps(own))
    assert again == own and gt.find(image, again) == fresh[0]


def enlarged(image: np.ndarray, times: int) -> np.ndarray:
    """(H, W) an image in which each pixel is a block of smooth ones."""
    return cv2.resize(image, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)


def test_a_large_image_tells_what_the_same_image_tells_that_is_small() -> None:
    """Regions are looked for in an image that is reduced, by a part's size: what is hidden, and where things lie, stays."""
    times, small = 3, part()
    views = [[gt.Contour((c.points + 0.5) * times - 0.5, hole=c.hole) for c in small.view.contours]]
    grasps = [gt.Grasp((g.contacts + 0.5) * times - 0.5) for g in small.grasps]
    large = gt.Part.of(enlarged(small.image, times), gt.View(views[0]), grasps, name="ell")
    image, hidden = tray(*THREE), np.zeros((times * SIZE[0], times * SIZE[1]), np.uint8)
    hidden[: times * 240, times * 380 :] = 255  # the last of the three
    found = gt.find(enlarged(image, times), large, ignore=hidden)
    assert [one.found for one in found] == [True] * 2
    for one in found:
        contacts = (one.contacts + 0.5) / times - 0.5
        assert min(np.hypot(*(contacts - truth(angle, at)).T).max() for _, angle, at in THREE[:2]) < 1.0
    with pytest.raises(InputError, match="mask"):
        gt.find(image, small, ignore=hidden)


def test_on_bare_ground_and_among_others_nothing_is_found() -> None:
    assert gt.find(np.full(SIZE, 180, np.uint8), part()) == []
    noise = np.random.default_rng(0).integers(0, 255, SIZE, dtype=np.uint8)
    assert not any(one.found for one in gt.find(cv2.GaussianBlur(noise, (0, 0), 3.0), part()))
    assert not any(one.found for one in gt.find(tray((HOOK, 0.3, (150.0, 150.0)), (HOOK, 2.0, (400.0, 300.0))), part()))


def test_what_lies_turned_over_is_told_and_never_given_as_found() -> None:
    found = gt.find(tray(THREE[0], (MIRRORED, 1.0, (400.0, 300.0))), part())
    assert [(one.found, one.mirrored, one.reason_code) for one in found] == [
        (True, False, ""), (False, True, "turned-over"),
    ]  # fmt: skip
    over = found[1]
    assert over.contacts is not None and np.linalg.det(over.homography[:2, :2]) < 0.0
    np.testing.assert_allclose(apply_homography(over.homography, part().grasps[0].contacts), over.contacts, atol=1e-6)


def test_what_never_lies_turned_over_is_not_looked_for_so(tmp_path: Path) -> None:
    own, image = part(), tray(THREE[0], (MIRRORED, 1.0, (400.0, 300.0)))
    assert [one.mirrored for one in gt.find(image, own)] == [False, True]
    replace(own, face_up=True).save(tmp_path / "ell.part")
    up = gt.Part.load(tmp_path / "ell.part")
    answers = gt.find(image, up)
    assert up.face_up and sum(one.found for one in answers) == 1 and not any(one.mirrored for one in answers)


def test_a_disc_may_lie_in_any_turn_and_is_not_given() -> None:
    found = gt.find(tray((DISC, 0.7, (400.0, 300.0))), part("disc", "DISC"))
    assert found and not any(one.found for one in found)


ROUND = 60.0 * np.column_stack([np.cos(np.linspace(0.0, 6.2832, 160)[:-1]), np.sin(np.linspace(0.0, 6.2832, 160)[:-1])])


def rings(scale: float, places: tuple[tuple[float, float], ...], size: tuple[int, int], hole: float) -> np.ndarray:
    """(H, W) discs at some places, each with a hole of that radius."""
    full, empty = (drawn(*each, centres=places, angle=0.0, size=size, contrast=85.0, noise=2.0, seed=3)
                   for each in ([scale * ROUND] * len(places), [0.01 * ROUND] * len(places)))  # fmt: skip
    y, x = np.mgrid[: size[0], : size[1]]
    for at in places:
        full = np.where(np.hypot(x - at[0], y - at[1]) < scale * hole, empty, full)
    return np.asarray(cv2.GaussianBlur(full, (0, 0), 0.7))


@pytest.mark.parametrize("hole", [0.0, 25.0])
def test_a_round_part_is_given_in_any_turn_where_nothing_else_is_open(hole: float) -> None:
    """A ring's two circles leave nothing open but the turn, a disc's one also a tilt; both were refused."""
    image = rings(1.0, ((160.0, 120.0),), (240, 320), hole)
    view = gt.first_look(image)[0].view
    taught = gt.Part.of(image, view, gt.synthesize(view, 2, top=1), name="round")
    places = ((150.0, 120.0), (420.0, 140.0), (300.0, 340.0))
    scene = rings(0.8, places, SIZE, hole)
    found = [one for one in gt.find(scene, taught) if one.found]
    assert len(found) == (3 if hole else 0)
    opening = 0.8 * np.hypot(*np.diff(taught.grasps[0].contacts, axis=0)[0])
    for one in [*found, *(one for one in gt.find(scene, replace(taught, same_tilt=True)) if one.found)]:
        away = np.array(places) - one.view.outer.points.mean(axis=0)
        at = places[int(np.hypot(*away.T).argmin())]
        assert one.any_turn and not one.turns
        np.testing.assert_allclose(np.hypot(*(one.contacts - at).T), 48.0, atol=1.0)
        np.testing.assert_allclose(np.hypot(*np.diff(one.contacts, axis=0)[0]), opening, atol=0.5)
    if hole:
        tracker, located = gt.SceneTracker(taught), 0
        for k in range(6):
            moved = tuple((x + 2.0 * k, y + k) for x, y in places)
            told = tracker.update(rings(0.8, moved, SIZE, hole), k / 30.0)
            for result in (each for each in told.results.values() if each.located):
                located += 1
                off = np.hypot(*(result.contacts[:, None] - np.array(moved)).T)
                assert np.abs(off.min(axis=0) - 48.0).max() < 1.0
        assert located >= 15


def test_a_crescent_slides_along_itself_and_is_not_given() -> None:
    """It was given where a prior of nothing but the way it was looked for made it exact: one of some was 6 px off."""
    for angle in (0.3, 2.0, 4.1):
        answers = gt.find(tray((CRESCENT, angle, (320.0, 240.0))), part("crescent", "CRESCENT"))
        assert [a.reason_code for a in answers] == ["uncertain"], answers


@pytest.mark.parametrize(("same_tilt", "least"), [(False, 2), (True, 10)])
def test_crescents_in_one_plane_tell_each_other_how_far_they_slid(same_tilt: bool, least: int) -> None:
    """But not how far all of them slid together, which the tilt of what taught them leaves open, unless it is the same."""
    places = [(x, y) for x in (150.0, 400.0, 650.0, 900.0) for y in (150.0, 400.0, 650.0)]
    angles = [0.3 + 0.7 * k for k in range(12)]
    shapes = [turned(0.8 * CRESCENT, angle) for angle in angles]
    image = drawn(*shapes, centres=tuple(places), angle=0.0, size=(800, 1050), contrast=85.0, noise=2.0, seed=3)
    crescent = replace(part("crescent", "CRESCENT"), same_tilt=same_tilt)
    found = [one for one in gt.find(image, crescent) if one.found]
    taught = crescent.grasps[0].contacts - centroid(crescent.view.outer.points)
    assert len(found) >= least
    for one in found:
        away = [
            np.hypot(*(turned(0.8 * taught, a) + turned(0.8 * centroid(CRESCENT)[None], a) + at - one.contacts).T).max()
            for a, at in zip(angles, places, strict=True)
        ]
        assert min(away) < 3.0


def test_a_piece_is_seen_from_where_its_image_was_taken() -> None:
    """It was taken for the upper left corner of an image, so that the sides of thick parts were looked for where none are."""
    image = drawn(ELL, centres=((470.0, 330.0),), angle=0.3, size=SIZE, seed=7)
    view = gt.first_look(image)[0].view
    whole = gt.Part.of(image, view, gt.synthesize(view, 2, top=1), name="ell")
    low = view.outer.points.mean(axis=0) - whole.view.outer.points.mean(axis=0)
    np.testing.assert_allclose(whole.seen_from, (640.0, 320.0 - low[0], 240.0 - low[1]), atol=1e-6)
    nowhere = replace(whole, origin=None)
    np.testing.assert_allclose(nowhere.seen_from[1:], np.array(whole.image.shape[1::-1]) / 2.0)
    over = whole.turned_over().seen_from
    np.testing.assert_allclose(over, (640.0, whole.image.shape[1] - whole.seen_from[1], whole.seen_from[2]))
    levels = build_pyramid(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image)
    piece = build_pyramid(cv2.cvtColor(whole.image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else whole.image)
    contacts = whole.grasps[0].contacts
    by_image = make_target(levels, view, contacts + low, NUMBERS)
    by_piece = make_target(piece, whole.view, contacts, NUMBERS, origin=whole.seen_from)
    leaning = np.array([[0.9, 0.1, 30.0], [-0.1, 0.95, 60.0], [1e-4, -2e-4, 1.0]])
    to_image = np.array([[1.0, 0.0, low[0]], [0.0, 1.0, low[1]], [0.0, 0.0, 1.0]])
    seen = build_pyramid(cv2.warpPerspective(levels[0], leaning, SIZE[::-1], borderMode=cv2.BORDER_REFLECT))
    for target, H, start in ((by_image, leaning, levels), (by_piece, leaning @ to_image, piece)):
        state = first_state(target, start)
        found = estimate_pose(state, seen, Hypothesis("match", target.pose(H), target.noise_of_guess), still=True)
        assert found is not None
        if target is by_image:
            first = found
    np.testing.assert_allclose(found.contacts, first.contacts, atol=0.02)
    np.testing.assert_allclose(found.nuisance, first.nuisance, atol=0.05)


@pytest.mark.slow
def test_half_discs_that_are_thick_are_found_where_they_lie_or_refused() -> None:
    """16 of 99 were given 10 px beside their place, as exact to half a pixel: the sides of what lies aside were not told."""
    robot = TrayRobot(TrayCase(SHAPES["half-disc"](), 11))
    given = 0
    for pose in robot.looks[4:8]:
        travel(robot.world, pose)
        for _ in range(5):
            robot.world.move(np.zeros(6))
        for one in gt.find(robot.world.image(), robot.taught.parts[0], ignore=robot.ignore):
            if one.found:
                part, places = robot._truth_of(one.contacts, 0)
                robot.world.chosen = part
                away = np.hypot(*(apply_homography(robot.world.outline_to_image(), places) - one.contacts).T).max()
                assert away <= 3.0, (one, away)
                given += 1
    assert given >= 25


def test_each_part_is_taken_for_itself_and_equals_for_neither() -> None:
    image = tray(THREE[0], (HOOK, 1.0, (400.0, 300.0)))
    found = gt.find(image, [part(), part("hook", "HOOK")])
    assert sorted((one.part, one.found) for one in found) == [("ell", True), ("hook", True)]
    twins = gt.find(image, [part(), part("twin")])
    assert [one.reason_code for one in twins].count("which-part") == 1
    assert not any(one.found for one in twins)
    with pytest.raises(InputError, match="two parts have the name"):
        gt.find(image, [part(), part("ell", "HOOK")])
    with pytest.raises(InputError, match='where the part "ell" was seen is not known'):
        gt.find(image, replace(part(), origin=None, same_tilt=True))
    with pytest.raises(InputError, match="parts must be a part"):
        gt.find(image, [])


def test_a_covered_part_is_found_or_told_and_comes_after_those_in_plain_view() -> None:
    image = tray(*THREE)
    cv2.rectangle(image, (455, 60), (500, 110), (180,), -1)  # the ground's level over a corner of the last
    found = [one for one in gt.find(image, part()) if one.found]
    assert len(found) >= 2 and found[0].edge >= found[-1].edge
    for one in found:
        assert min(np.hypot(*(one.contacts - truth(angle, at)).T).max() for _, angle, at in THREE) < 2.0


@given(st.floats(0.0, 6.28), st.floats(0.0, 6.28), st.floats(60.0, 90.0))
def test_parts_that_lie_over_each_other_are_both_found_or_told(first: float, second: float, apart: float) -> None:
    """One silhouette of two parts of one grey: the third in view tells their size, and each what of the other is not seen."""
    placed = [*zip((first, second), ((200.0, 240.0), (200.0 + apart, 240.0)), strict=True), (0.4, (500.0, 130.0))]
    found = [one for one in gt.find(tray(*((ELL, *each) for each in placed)), part()) if one.found]
    nearest = [min(range(3), key=lambda k: np.hypot(*(one.contacts - truth(*placed[k])).T).max()) for one in found]
    assert len(set(nearest)) == len(found) and 2 in nearest
    for one, k in zip(found, nearest, strict=True):
        assert np.hypot(*(one.contacts - truth(*placed[k])).T).max() < 3.0


def test_many_of_the_parts_that_lie_over_each_other_are_found() -> None:
    """One of eighty was, while what one covers of another spoke against both."""
    rng, found = np.random.default_rng(4), 0
    for _ in range(12):
        turns, apart = rng.uniform(0.0, 6.28, 2), rng.uniform(60.0, 90.0)
        image = tray((ELL, turns[0], (200.0, 240.0)), (ELL, turns[1], (200.0 + apart, 240.0)), THREE[2])
        found += sum(one.found for one in gt.find(image, part())) - 1
    assert found >= 8


def test_a_part_taught_aslant_is_found_in_each_of_its_turns() -> None:
    """Seen from nearby no turn of a star's image fits itself; its turns were taken for rivals, and it was missed."""
    image = drawn(STAR, centres=((160.0, 120.0),), angle=0.0, seed=7)
    aslant = np.array([[1.0, 0.0, 0.0], [0.0, 0.97, 0.0], [2e-4, 4e-4, 1.0]])
    image = cv2.warpPerspective(image, aslant, (320, 240), borderMode=cv2.BORDER_REPLICATE)
    view = gt.first_look(image)[0].view
    star = gt.Part.of(image, view, gt.synthesize(view, 2, top=1), name="star")
    (one,) = gt.find(tray((STAR, 0.2, (300.0, 240.0))), star)
    assert one.found and len(one.turns) == 4
    np.testing.assert_allclose(sorted(one.turns), [-144.0, -72.0, 72.0, 144.0], atol=3.0)


def test_a_neighbour_takes_the_room_of_the_fingers() -> None:
    angle, at = 0.0, (200.0, 200.0)
    contact = truth(angle, at)[0]
    away = -part().directions[0][0]
    free = [one for one in gt.find(tray((ELL, angle, at)), part()) if one.found]
    beside = contact + away * 10.0 + away * np.abs(SMALL).max()
    near = [one for one in gt.find(tray((ELL, angle, at), (SMALL, 0.0, tuple(beside.tolist()))), part()) if one.found]
    assert len(free) == len(near) == 1 and np.isinf(free[0].room) and near[0].room < 12.0


SMALL = 16.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)


def test_the_verbs_teach_find_and_list(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite(str(tmp_path / "one.png"), drawn(ELL, centres=((160.0, 120.0),), angle=0.0, seed=7))
    cv2.imwrite(str(tmp_path / "tray.png"), tray(*THREE))
    cv2.imwrite(str(tmp_path / "none.png"), tray((HOOK, 0.3, (150.0, 150.0))))
    shelf, out = tmp_path / "shelf", tmp_path / "out"
    shelf.mkdir()
    taught = ["teach", str(tmp_path / "one.png"), "--name", "ell", "--output", str(shelf / "ell.part"), "--scale", "4"]
    assert main(taught) == 0 and "ell" in capsys.readouterr().out
    assert main([*taught, "--quiet"]) == 0  # an existing part is replaced
    assert main(["find", str(tmp_path / "tray.png"), "--part", str(shelf), "--output", str(out)]) == 0
    told = json.loads((out / "instances.json").read_text())
    rows = list(csv.DictReader((out / "instances.csv").open()))
    assert [one["found"] for one in told["instances"]] == [True] * 3 == [row["found"] == "1" for row in rows]
    assert [float(row["x1"]) for row in rows] == pytest.approx(
        [one["contacts"][0][0] for one in told["instances"]], abs=1e-3
    )
    assert sorted(told["files"]) == sorted(path.name for path in out.iterdir())
    cv2.imwrite(str(tmp_path / "over.png"), tray(THREE[0], (MIRRORED, 1.0, (400.0, 300.0))))
    capsys.readouterr()
    assert main(["find", str(tmp_path / "over.png"), "--part", str(shelf), "--output", str(tmp_path / "over")]) == 0
    assert "turned-over: of a part that cannot lie so, teach it with --face-up" in " ".join(
        capsys.readouterr().out.split()
    )
    assert main(["parts", str(shelf), "--output", str(out)]) == 0
    assert json.loads((out / "parts.json").read_text())["parts"][0]["size_mm"][0] == pytest.approx(38.5, abs=1.0)
    assert cv2.imread(str(out / "parts.png")) is not None and cv2.imread(str(out / "instances.png")) is not None
    capsys.readouterr()
    assert main(["find", str(tmp_path / "none.png"), "--part", str(shelf), "--output", str(out), "--quiet"]) == 3
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and "no instance" in said.err


def test_bad_input_is_one_line_and_nothing_is_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image, other = tmp_path / "one.png", tmp_path / "notes.part"
    cv2.imwrite(str(image), drawn(ELL, centres=((160.0, 120.0),), angle=0.0, seed=7))
    other.write_text("my own")
    for asked in (
        ["teach", str(image), "--name", "ell", "--output", str(other)],
        ["teach", str(image), "--name", "ell", "--output", str(image)],
        ["teach", str(image), "--name", "", "--output", str(tmp_path / "a.part")],
        ["teach", str(image), "--name", "ell", "--output", str(tmp_path / "a.part"), "--grasp", "5,5 8,8"],
        ["find", str(image), "--part", str(other)],
        ["find", str(tmp_path / "none.png"), "--part", str(tmp_path / "none.part")],
    ):
        assert main(asked) == 2
        said = capsys.readouterr()
        assert said.out == "" and said.err.count("\n") == 1
    assert other.read_text() == "my own" and sorted(p.name for p in tmp_path.iterdir()) == ["notes.part", "one.png"]


@pytest.mark.parametrize(("outline", "slides"), [("CRESCENT", True), ("ELL", False), ("HOOK", False)])
def test_contacts_slide_along_an_outline_of_few_arcs_while_edges_stay(outline: str, slides: bool) -> None:
    known = part(outline.lower(), outline)
    target = make_target(build_pyramid(known.image), known.view, known.grasps[0].contacts, NUMBERS)
    step = 1e-3
    moved = target.handle.moved(target.A, step * target.slide)

    def way(places: np.ndarray) -> np.ndarray:
        return (apply_homography(moved, places) - apply_homography(target.A, places)) / (step * target.A[0, 0])

    contacts = np.hypot(*way(target.work_contacts).T)
    across = (way(target.points) * target.normals).sum(axis=1)
    assert np.sqrt(np.mean(contacts**2)) == pytest.approx(1.0, rel=0.02)
    least = np.sqrt(np.mean(across**2))
    assert target.slides == slides == (least * NUMBERS.tolerance_px < NUMBERS.edge_floor)
    for d in np.eye(8) * step:  # no other error moves them by so much more than edges
        G = target.handle.moved(target.A, d)
        c = np.hypot(*(apply_homography(G, target.work_contacts) - apply_homography(target.A, target.work_contacts)).T)
        e = ((apply_homography(G, target.points) - apply_homography(target.A, target.points)) * target.normals).sum(
            axis=1
        )
        assert np.sqrt(np.mean(e**2)) >= 0.98 * least * np.sqrt(np.mean(c**2))
