# SPDX-License-Identifier: Apache-2.0
"""A tracker that knows the lens: px of the images as they are go in and come out, and straight lines are seen straight."""

import json
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack import inspect
from grasptrack.cli.main import main
from grasptrack.errors import InputError, SourceError
from grasptrack.geometry.cameras import Camera
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.images import to_bgr
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.undistortion import MOST, Undistortion
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.simulation import DISTURBANCES, SHAPES, SceneFrame
from recordings import rows

BARREL = Camera([[704, 0, 319.5], [0, 704, 239.5], [0, 0, 1]], (-0.2, 0.03, 0.001, -0.001), size=(640, 480))


@lru_cache
def frames(seed: int = 0) -> tuple[list[SceneFrame], Camera]:
    scene = DISTURBANCES["lens"].scene(SHAPES["bracket"](), 6, seed)
    lens = scene.camera
    return list(scene), Camera(lens.matrix, (lens.k1, lens.k2, 0, 0), size=(lens.width, lens.height))


def errors(tracker: GraspTracker, seen: list[SceneFrame], contacts: np.ndarray) -> np.ndarray:
    first = tracker.update(seen[0].image, time=seen[0].time)
    assert first.contacts is not None and np.abs(first.contacts - contacts).max() < 1.0
    off = []
    for frame in seen[1:]:
        result = tracker.update(frame.image, time=frame.time)
        assert result.contacts is not None, result.reason
        off.append(np.hypot(*(result.contacts - frame.carry(first.contacts)).T))
    return np.concatenate(off)


@pytest.mark.slow
def test_the_error_that_the_lens_makes_is_gone() -> None:
    """Of barrels and a pincushion together: what noise makes alone is not a fixed share of a single lens's error."""
    plain, known = [], []
    for seed in (2, 3, 4):
        seen, camera = frames(seed)
        contacts = chosen_grasp(seen[0].outline)
        plain.append(errors(GraspTracker(grasp=contacts), seen, contacts))
        known.append(errors(GraspTracker(grasp=contacts, camera=camera), seen, contacts))
        assert np.sqrt((known[-1] ** 2).mean()) < 0.04
    assert np.sqrt((np.concatenate(known) ** 2).mean()) < 0.6 * np.sqrt((np.concatenate(plain) ** 2).mean())


def test_a_camera_without_distortion_changes_nothing_but_the_focal_length() -> None:
    seen, camera = frames()
    straight = Camera(camera.matrix, (0, 0, 0, 0), size=camera.size)
    bare, told = GraspTracker(object_at=(320, 240)), GraspTracker(object_at=(320, 240), camera=straight)
    for frame in seen[:3]:
        a, b = bare.update(frame.image), told.update(frame.image)
        assert a.status == b.status and a.contacts is not None and b.contacts is not None
        assert np.abs(a.contacts - b.contacts).max() < (0.02 if a.frame else 1e-9)
        assert np.array_equal(Undistortion(straight, 640, 480).straight_image(frame.image), to_bgr(frame.image))


def test_the_homography_is_that_between_ideal_images() -> None:
    seen, camera = frames()
    tracker = GraspTracker(camera=camera)
    first = tracker.update(seen[0].image)
    result = tracker.update(seen[1].image)
    assert first.contacts is not None and result.contacts is not None and result.homography is not None
    carried = camera.distort(apply_homography(result.homography, camera.undistort(first.contacts)))
    assert np.allclose(carried, result.contacts, atol=1e-6)
    corners = np.array([[200.0, 150.0], [440.0, 330.0]])
    true = apply_homography(seen[1].H_current_reference, corners)
    assert np.abs(apply_homography(result.homography, corners) - true).max() < 0.5


def test_the_covariance_of_the_homography_is_in_ideal_px_as_well() -> None:
    """By finite differences of the homography that is told."""
    lens, rng = Undistortion(BARREL, 640, 480), np.random.default_rng(0)
    assert np.abs(lens.offset).max() > 1.0
    H = np.eye(3) + rng.normal(0.0, [[0.1, 0.1, 20.0], [0.1, 0.1, 20.0], [1e-4, 1e-4, 0.0]])
    free = np.diag([1.0] * 8 + [0.0])
    C = free @ (lambda A: A @ A.T)(rng.normal(size=(9, 9)) * 1e-6) @ free

    def told(H: np.ndarray) -> TrackResult:
        return lens.result_seen(TrackResult(0, None, "tracked", "", homography=H / H[2, 2], homography_covariance=C))

    J = np.zeros((9, 9))
    for k in range(8):
        step = np.zeros(9)
        step[k] = 1e-6
        more, less = (told(H + sign * step.reshape(3, 3)).homography for sign in (1.0, -1.0))
        assert more is not None and less is not None
        J[:, k] = (more - less).ravel() / 2e-6
    found = told(H).homography_covariance
    assert found is not None and np.abs(found[8]).max() < 1e-20
    np.testing.assert_allclose(found, J @ C @ J.T, rtol=1e-5, atol=1e-6 * np.abs(found).max())


def test_the_outline_lies_on_the_edge_that_is_seen() -> None:
    seen, camera = frames()
    view = GraspTracker(camera=camera).update(seen[0].image).view
    assert view is not None
    truth = np.concatenate(seen[0].outline)
    far = [np.hypot(*(truth - p).T).min() for p in view.outer.points[::25]]
    assert np.median(far) < 1.0


def seen_by_barrel(*plates: list[list[int]]) -> np.ndarray:
    """Dark plates, given in ideal px, on a light table that reaches beyond the image, as the barrel shows them."""
    ideal = np.full((560, 760), 200, np.uint8)
    for plate in plates:
        cv2.fillPoly(ideal, [np.array(plate)], 60)
    x, y = np.meshgrid(np.arange(640.0), np.arange(480.0))
    back = BARREL.undistort(np.stack([x, y], axis=-1).reshape(-1, 2)).reshape(480, 640, 2).astype(np.float32)
    return np.asarray(cv2.remap(ideal, back[..., 0], back[..., 1], cv2.INTER_LINEAR, borderValue=200))


def contacts_of(out: Path) -> np.ndarray:
    """(F, 4) of a run's table."""
    return np.array([[float(row[c]) for c in ("x1", "y1", "x2", "y2")] for row in rows(out)])


def written(file: Path, camera: Camera) -> Path:
    """A calibration's file."""
    content = {"K": camera.matrix.tolist(), "D": camera.distortion.tolist(), "image_size": camera.size}
    file.write_text(json.dumps(content))
    return file


@lru_cache
def two_plates() -> np.ndarray:
    """A large and a small plate near a corner, as the barrel sees them."""
    image = seen_by_barrel([[250, 150], [400, 160], [390, 330], [260, 320]], [[20, 20], [110, 25], [100, 90], [30, 95]])
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8))


SMALL = BARREL.distort([[65.0, 57.0]])[0]
"""The small plate's middle, as it is seen."""


@pytest.mark.sampled(2)
@pytest.mark.parametrize("how", ["pixel", "box", "grasp", "ignore", "mask"])
def test_whatever_names_the_object_is_in_px_of_the_image(how: str) -> None:
    image = two_plates()
    corners = BARREL.distort([[20.0, 20.0], [110, 25], [100, 90], [30, 95]])
    (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0)
    mask = np.zeros(image.shape, np.uint8)
    cv2.fillPoly(mask, [np.round(BARREL.distort([[240, 140], [410, 150], [400, 340], [250, 330]])).astype(int)], 255)
    options: dict = {
        "pixel": {"object_at": tuple(SMALL)},
        "box": {"box": (left, top, right - left, bottom - top)},
        "grasp": {"grasp": BARREL.distort([[25.0, 57.0], [105.0, 57.0]])},
        "ignore": {"ignore": mask},
        "mask": {},
    }[how]
    given = np.zeros(image.shape, np.uint8)
    cv2.fillPoly(given, [np.round(corners).astype(int)], 255)
    result = GraspTracker(camera=BARREL, **options).update(image, mask=given if how == "mask" else None)
    assert result.view is not None, result.reason
    assert np.hypot(*(result.view.outer.points.mean(axis=0) - SMALL)) < 6.0


def test_masks_and_images_of_another_size_are_refused() -> None:
    tracker = GraspTracker(camera=BARREL)
    with pytest.raises(InputError, match="the calibration is for 640x480 px, the images are 640x360"):
        tracker.update(np.zeros((360, 640), np.uint8))
    tracker = GraspTracker(camera=BARREL)
    tracker.update(two_plates())
    with pytest.raises(SourceError, match="320x240 px, but the first was 640x480"):
        tracker.update(np.zeros((240, 320), np.uint8))
    with pytest.raises(InputError, match="the mask is 320x240"):
        tracker.update(two_plates(), mask=np.zeros((240, 320), np.uint8))
    with pytest.raises(InputError, match="the ignore mask is 320x240"):
        GraspTracker(camera=BARREL, ignore=np.zeros((240, 320), np.uint8)).update(two_plates())


def test_covariance_and_outline_are_carried_by_the_lens() -> None:
    lens = Undistortion(BARREL, 640, 480)
    contacts = np.array([[60.0, 80.0], [500.0, 400.0]])
    covariance = np.array([[[0.04, 0.01], [0.01, 0.09]], [[0.01, 0.0], [0.0, 0.25]]])
    ring = Contour(200 + 90 * np.column_stack([np.cos(np.arange(40) / 6.4), np.sin(np.arange(40) / 6.4)]))
    given = TrackResult(0, None, "tracked", "", contacts=contacts, covariance=covariance, view=View(ring))
    told = lens.result_seen(given)
    assert told.contacts is not None and told.covariance is not None and told.view is not None
    draws = np.random.default_rng(0).multivariate_normal(contacts[0], covariance[0], 40000)
    assert np.allclose(np.cov(lens.points_seen(draws).T), told.covariance[0], rtol=0.05, atol=3e-4)
    assert np.allclose(lens.straight_points(told.contacts), contacts, atol=1e-9)
    assert np.allclose(lens.straight_points(told.view.outer.points), ring.points, atol=1e-9)


@pytest.mark.parametrize("k1", [-0.25, -0.05, 0.15])
def test_all_that_was_seen_is_in_the_straight_image(k1: float) -> None:
    lens = Undistortion(Camera(BARREL.matrix, (k1, 0, 0, 0), size=(640, 480)), 640, 480)
    border = np.array([(x, y) for x in (0, 320, 639) for y in (0, 240, 479)], dtype=float)
    at = np.rint(lens.straight_points(border)).astype(int)
    height, width = lens.hidden.shape
    inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    assert inside.all() or width > 640 * (1 + 2 * MOST) - 20
    shown = np.argwhere(lens.hidden == 0)[::997, ::-1]
    seen = lens.points_seen(shown)
    assert ((seen >= -0.5) & (seen <= (639.5, 479.5))).all()
    ramp = np.tile(np.linspace(20, 220, 640).astype(np.uint8), (480, 1))
    straight = lens.straight_image(ramp)[shown[:, 1], shown[:, 0]]
    assert np.abs(straight - np.interp(seen[:, 0], np.arange(640), ramp[0])).max() <= 1.5


def test_what_the_border_of_the_image_seen_cuts_is_cut() -> None:
    image = seen_by_barrel([[500, 180], [740, 190], [730, 360], [510, 350]])
    view = GraspTracker(camera=BARREL, object_at=(560.0, 250.0)).update(image).view
    assert view is not None and view.outer.clipped is not None
    assert (view.outer.points[view.outer.clipped, 0] > 630).all()  # where the object goes on outside, and only there
    assert view.outer.clipped[view.outer.points[:, 0] > 636].mean() > 0.9
    hidden = np.zeros(image.shape, np.uint8)
    hidden[:, 600:] = 255
    view = GraspTracker(ignore=hidden, object_at=(560.0, 250.0)).update(image).view
    assert (
        view is not None and view.outer.clipped is not None and (view.outer.points[view.outer.clipped, 0] > 590).all()
    )


@pytest.fixture
def scene(tmp_path: Path) -> tuple[Path, Path, list[SceneFrame]]:
    seen, camera = frames(3)
    folder = tmp_path / "in"
    folder.mkdir()
    for i, frame in enumerate(seen[:3]):
        cv2.imwrite(str(folder / f"{i}.png"), frame.image)
    return folder, written(tmp_path / "camera.json", camera), seen


def test_track_with_a_calibration(scene: tuple[Path, Path, list[SceneFrame]], tmp_path: Path) -> None:
    folder, file, seen = scene
    x, y = chosen_grasp(seen[0].outline)
    text = f"{x[0]},{x[1]} {y[0]},{y[1]}"
    out = tmp_path / "out"
    given = ["track", str(folder), "--grasp", text, "--output", str(out), "--quiet", "--no-video"]
    assert main([*given, "--camera", str(file)]) == 0
    found = contacts_of(out).reshape(-1, 2, 2)
    assert np.abs(found[2] - seen[2].carry(found[0])).max() < 0.1
    assert json.loads((out / "run.json").read_text())["options"]["camera"] == str(file)


@pytest.mark.slow
def test_a_calibration_of_larger_images_is_scaled_and_the_user_told(
    scene: tuple[Path, Path, list[SceneFrame]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, file, _ = scene
    small = json.loads(file.read_text())
    larger = {**small, "K": [[2 * a + (0.5 if j == 2 else 0.0) for j, a in enumerate(row)] for row in small["K"][:2]]}
    larger["K"].append([0.0, 0.0, 1.0])
    (tmp_path / "large.json").write_text(json.dumps({**larger, "image_size": [1280, 960]}))
    found = []
    for name, out in ((file, tmp_path / "a"), (tmp_path / "large.json", tmp_path / "b")):
        assert main(["track", str(folder), "--camera", str(name), "--output", str(out), "--no-video"]) == 0
        told = "the calibration, of 1280x960 px, was scaled to the images' 640x480" in capsys.readouterr().out
        assert told is (name != file)
        found.append(contacts_of(out))
    assert np.allclose(*found, atol=2e-3)


def test_synthesize_with_a_calibration(scene: tuple[Path, Path, list[SceneFrame]], tmp_path: Path) -> None:
    folder, file, seen = scene
    out = tmp_path / "out"
    assert main(["synthesize", str(folder / "0.png"), "--camera", str(file), "--output", str(out), "--quiet"]) == 0
    found = json.loads((out / "grasps.json").read_text())["objects"][0]
    truth = np.concatenate(seen[0].outline)
    sides = np.concatenate([np.linspace(a, b, 50) for a, b in zip(truth, np.roll(truth, -1, axis=0), strict=True)])
    for contact in found["grasps"][0]["contacts"]:
        assert np.hypot(*(sides - contact).T).min() < 1.0
    straight = frames(3)[1].undistort(found["grasps"][0]["contacts"])
    assert found["grasps"][0]["opening_px"] == pytest.approx(np.hypot(*(straight[0] - straight[1])), abs=2e-3)


@pytest.mark.slow
def test_transfer_with_a_calibration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clean = DISTURBANCES["clean-6dof"].scene(SHAPES["bracket"](), 1, 3)[0]
    camera = Camera([[520, 0, 120], [0, 520, 90], [0, 0, 1]], (0.25, 0.05, 0, 0), size=(640, 480))  # far off its axis
    turned = similarity_transform(1.05, 2.2, (320.0, 240.0), (280.0, 215.0))
    ideal = camera.undistort(np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1).reshape(-1, 2))
    for name, H in (("a", np.eye(3)), ("b", turned)):
        at = apply_homography(np.linalg.inv(H), ideal).astype(np.float32).reshape(480, 640, 2)
        image = cv2.remap(clean.image, at, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    file = written(tmp_path / "camera.json", camera)

    def truth(points: np.ndarray) -> np.ndarray:
        return camera.distort(apply_homography(turned, camera.undistort(points)))

    x, y = camera.distort(np.array(chosen_grasp(clean.outline)))
    middle = truth(np.array([x, y])).mean(axis=0)
    given = ["transfer", str(tmp_path / "a.png"), str(tmp_path / "b.png"), "--output", str(tmp_path)]
    given += ["--grasp", f"{x[0]},{x[1]} {y[0]},{y[1]}", "--object-b", f"{middle[0]},{middle[1]}"]
    off = []
    for more in (["--camera", str(file)], []):
        assert main([*given, *more]) == 0
        rows = {line.split()[0]: line.split() for line in capsys.readouterr().out.splitlines() if line.split()}
        if not more and rows["registration"][1] == "refused":
            continue
        start, end = (
            np.array([pair.split(",") for pair in rows[name][1:3]], dtype=float)
            for name in ("(reference)", "registration")
        )
        assert np.abs(start - [x, y]).max() < 1.0  # px of the image, in which the contacts were given
        off.append(np.abs(end - truth(start)).max())
    assert off[0] < 0.2  # they are written with one decimal
    assert len(off) == 1 or off[1] > 2.0 * off[0]
    assert cv2.imread(str(tmp_path / "transfer.png")) is not None


@pytest.mark.slow
def test_inspect_with_a_calibration(scene: tuple[Path, Path, list[SceneFrame]], tmp_path: Path) -> None:
    folder, file, seen = scene
    camera = frames(3)[1]
    given = ["inspect", str(folder / "0.png"), "--output", str(tmp_path), "--quiet"]
    assert main([*given, "--camera", str(file)]) == 0
    found = json.loads((tmp_path / "inspect.json").read_text())
    chosen = GraspTracker(camera=camera).update(seen[0].image)
    assert chosen.contacts is not None and chosen.view is not None
    assert np.allclose(found["grasp"]["contacts"], chosen.contacts, atol=1e-3)
    assert np.allclose(found["outline"][0], chosen.view.outer.points, atol=2e-3)
    assert found["options"]["camera"] == str(file)
    lens, straight = Undistortion(camera, 640, 480), camera.undistort(chosen.contacts)
    J = lens.point_jacobian(straight - lens.offset)
    focal = Beforehand.by_calibration(lens.focal, NUMBERS)
    ideal = inspect(lens.straight_image(seen[0].image), ignore=lens.ignored_pixels(None), focal=focal)
    assert ideal.grasp is not None
    assert np.allclose(found["grasp"]["covariance_px2"], J @ ideal.grasp.covariance @ np.swapaxes(J, 1, 2), rtol=1e-3)
    assert found["error_px"] == pytest.approx(ideal.error_px, rel=1e-5)
    assert found["located_interval"] == pytest.approx(ideal.located_interval)
    along = np.diff(chosen.view.outer.points, axis=0)
    peaks = np.array(found["peaks"])
    apart = np.hypot(*(peaks[:, None] - chosen.view.outer.points[None]).transpose(2, 0, 1)).min(axis=1)
    assert len(peaks) and apart.max() < np.hypot(*along.T).max()


def test_a_calibration_by_which_nothing_is_seen_is_one_line(
    scene: tuple[Path, Path, list[SceneFrame]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, file, _ = scene
    file.write_text('{"K": [700, 0, 320, 0, 700, 240, 0, 0, 1], "D": [0, 0, 0, 1e308, 0]}')
    assert main(["synthesize", str(folder / "0.png"), "--camera", str(file), "--output", str(tmp_path), "--quiet"]) == 2
    error = capsys.readouterr().err
    assert "shows nothing within its image" in error and error.count("\n") == 1


def test_a_calibration_of_other_images_is_one_line(
    scene: tuple[Path, Path, list[SceneFrame]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, file, _ = scene
    file.write_text('{"width": 1280, "height": 720, "focal": 900, "k1": -0.1}')
    image = str(folder / "0.png")
    for verb in (
        ["track", str(folder), "--output", str(tmp_path / "o")],
        ["synthesize", image],
        ["inspect", image],
        ["transfer", image, image],
    ):
        assert main([*verb, "--camera", str(file), "--quiet"]) == 2
        error = capsys.readouterr().err
        assert "the calibration is for 1280x720 px, the images are 640x480" in error and error.count("\n") == 1
    assert main(["track", str(folder), "--camera", str(folder / "0.png"), "--output", str(tmp_path / "o")]) == 2
    assert "is no text file" in capsys.readouterr().err
