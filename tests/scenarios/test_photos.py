# SPDX-License-Identifier: Apache-2.0
"""Real photos, which are no part of the repository: tools on a glossy and on a dirty bench, several parts at once."""

import cv2
import numpy as np
import pytest

from datasets import DATA
from grasptrack.first_image import FirstImage
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.synthesis import synthesize
from grasptrack.segmentation.first_look import find_objects
from grasptrack.tracking.image_pair import transfer_between_images
from grasptrack.transfer.alignment import as_similarity, find_alignments
from grasptrack_bench.metrics.mask_agreement import boundary_f, intersection_over_union, mask_of
from research.studies.common import create_parser, parse_with_photos
from research.studies.hand_motions import draw_motion
from research.studies.moved_photos import draw_scene, follow_tool

pytestmark = pytest.mark.skipif(
    not (DATA / "tools").is_dir(), reason=f"no photos in {DATA}; set GRASPTRACK_DATA to the folder that holds tools/"
)


@pytest.mark.slow
@pytest.mark.parametrize(("bench", "share"), [("2023-08", 9 / 27), ("2023110", 19 / 27)])
def test_most_tools_are_found_whole_without_a_hint(bench: str, share: float) -> None:
    """Black and glossy, white and dirty; the shares are what was reached, less three photos."""
    good = []
    for photo in sorted((DATA / "tools" / "images").glob(f"{bench}*.jpg")):
        truth = cv2.imread(str(DATA / "tools" / "masks" / f"{photo.stem}.png"), cv2.IMREAD_UNCHANGED) > 0
        image = cv2.imread(str(photo))
        found = mask_of(find_objects(image)[0].view, truth.shape)
        good.append(boundary_f(found, truth) >= 0.9 and intersection_over_union(found, truth) >= 0.7)
    assert np.mean(good) >= share, f"{sum(good)} of {len(good)}"


def test_six_parts_are_six() -> None:
    found = find_objects(cv2.imread(str(DATA / "stills" / "pca_test1.jpg")))
    areas = np.array([c.view.outer.area for c in found])
    assert len(found) == 6
    assert areas.max() < 1.25 * areas.min()


def test_the_best_grasp_of_one_part_is_the_best_of_the_other_five() -> None:
    """Up to the part's half turn, and as well as the outlines agree: laid on each other they are 2 to 6 px apart, rms."""
    first, *others = find_objects(cv2.imread(str(DATA / "stills" / "pca_test1.jpg")))
    best = synthesize(first.view)[0].contacts
    for other in others:
        own = synthesize(other.view)[0].contacts
        ways = find_alignments(first.view.outer, other.view.outer)
        moved = [apply_homography(as_similarity(a, first.view.outer, other.view.outer), best) for a in ways]
        apart = min(np.hypot(*(m[order] - own).T).max() for m in moved for order in ([0, 1], [1, 0]))
        assert apart < 0.05 * np.sqrt(other.view.outer.area)


@pytest.mark.slow
def test_a_grasp_of_one_part_is_carried_to_its_neighbours() -> None:
    """Whatever is believed lies on the part that was pointed at; of one that may lie half turned both places are told."""
    image = cv2.imread(str(DATA / "stills" / "pca_test1.jpg"))
    first, *others = find_objects(image)
    grasp = synthesize(first.view)[0]
    carried = 0
    for other in others:
        x, y = other.view.outer.points.mean(axis=0).tolist()
        pair = transfer_between_images(grasp, first.view, image, image, 0.5, FirstImage.of((x, y)))
        believed = [o for o in pair.outcomes if not o.reason]
        carried += bool(believed) or len(pair.places) == 2
        assert not pair.places or sum(place.share for place in pair.places) == pytest.approx(1.0, abs=0.01)
        for outcome in believed:
            assert outcome.contacts is not None and outcome.analysis is not None and outcome.analysis.stable
            assert np.hypot(*(outcome.contacts.mean(axis=0) - (x, y))) < 0.1 * np.sqrt(other.view.outer.area)
    assert carried >= 4


@pytest.mark.slow
def test_what_compression_makes_look_better_is_no_sign_that_a_tool_slid(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search about the place found the blocks of the encoder: 2 to 4 px off for ten images, told as sure."""
    monkeypatch.setattr("sys.argv", ["", "--data", str(DATA)])
    _, photos = parse_with_photos(create_parser(""))
    found = follow_tool(draw_scene(photos[38], photos[0], "h264-36", 24, 11))
    assert found["wrong"] == 0 and found["right"] > 20


@pytest.mark.slow
def test_a_jerk_is_told_by_the_ground_where_a_search_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hand of a public benchmark (POT-280, V11_7) in motion blur: the keypoints were 5 px off, the ground 0.5 px."""
    monkeypatch.setattr("sys.argv", ["", "--data", str(DATA)])
    _, photos = parse_with_photos(create_parser(""))
    path = np.array(
        [
            [658.0, 339.0, 747.0, 241.0, 852.0, 327.0, 754.0, 417.0],
            [628.0, 363.0, 709.0, 253.0, 824.0, 340.0, 726.0, 430.0],
            [520.0, 412.0, 630.0, 322.0, 723.0, 424.0, 601.0, 502.0],
            [342.0, 393.0, 499.0, 316.0, 565.0, 454.0, 394.0, 516.0],
        ]
    )
    found = follow_tool(draw_motion(photos[26], np.array([147, 151, 155, 159]), path.reshape(-1, 4, 2), 0.5, 88))
    assert found["wrong"] == 0 and found["right"] >= 3
