# SPDX-License-Identifier: Apache-2.0
"""How far the object is, where its length is told: exact where the plane is known, and as sure as it says elsewhere."""

import csv
import json
import math
from pathlib import Path as FilePath

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from approaches import approach
from grasptrack import GraspTracker
from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.geometry.cameras import Camera
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.hand import parse_measure
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.estimator import first_state
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.plane import Plane, Ruler, outline_extent
from grasptrack.tracking.state import TrackState
from grasptrack.tracking.target import Grey, Target
from grasptrack.undistortion import Undistortion
from test_plane import FOCAL, HEIGHT, WIDTH, Followed, camera, plane_of, rendered, slopes, turned

BOX = np.array([[-3.0, -1.0], [3.0, -1.0], [3.0, 1.0], [-3.0, 1.0]])


@given(st.floats(0.5, 300.0), st.floats(0.1, 1.0), st.floats(-3.0, 3.0), st.floats(-400.0, 400.0))
def test_the_length_of_a_rectangle_is_its_longer_side(long: float, share: float, turn: float, away: float) -> None:
    z = (0.5 * long * (BOX / 3.0 * (1.0, 3.0 * share)) @ [1, 1j]) * np.exp(1j * turn) + away
    assert outline_extent(np.column_stack([z.real, z.imag])) == pytest.approx(long, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "value", "unit"), [("120mm", 120, "mm"), ("12 cm", 12, "cm"), (".12m", 0.12, "m"), (" 4.7in ", 4.7, "in")]
)
def test_lengths_as_they_are_written(text: str, value: float, unit: str) -> None:
    assert parse_measure(text, "--length") == (value, unit)


@pytest.mark.parametrize("text", ["", "120", "120px", "30%", "-3mm", "0mm", "1e3mm", "3 mm 2", "mm", "120 km"])
def test_what_is_no_length(text: str) -> None:
    with pytest.raises(InputError, match="--length is a length such as 120mm"):
        parse_measure(text, "--length")


@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf])
def test_a_length_that_is_none(length: float) -> None:
    with pytest.raises(InputError, match="length must be a positive number"):
        GraspTracker(length=length)


def views(
    first: tuple[float, float], now: tuple[float, float], roll: float, far: float, middle: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Of a box 6 units long: H_current_reference (3, 3), its first outline (4, 2) px, and how far its middle is now."""
    start = rendered(first, FOCAL)
    R, t = turned(now, roll), np.array([0.3, -0.2, far])
    H = camera() @ np.column_stack([R[:, :2], t]) @ np.linalg.inv(start)
    return H / H[2, 2], apply_homography(start, BOX / 6.0), float(np.linalg.norm(R[:, :2] @ middle + t))


def known_plane(first: tuple[float, float], outline: np.ndarray, *sds: float) -> Plane:
    """A plane that is known but for errors of so much: of all, or of the focal length and both slopes."""

    class Seen(Followed):
        pass

    Seen.outline = outline  # type: ignore[misc]
    return plane_of(Seen(), np.array([math.log(FOCAL), *first]), np.diag(np.square(sds) * np.ones(3)))


@given(slopes, slopes, st.floats(-3.0, 3.0), st.floats(3.0, 20.0), st.floats(1.0, 500.0))
def test_the_distance_is_true_where_the_plane_is_known(
    first: tuple[float, float], now: tuple[float, float], roll: float, far: float, length: float
) -> None:
    middle = (0.1, -0.05)
    H, outline, true = views(first, now, roll, far, middle)
    at = apply_homography(rendered(first, FOCAL), np.array([middle]))[0]
    plane = known_plane(first, outline, 1e-7)
    told = Ruler(plane, at, 0.0, length).distance_in(H, np.zeros((9, 9)))
    assert told.value == pytest.approx(length * true, rel=1e-4)
    assert told.sd < 1e-4 * told.value
    off = Ruler(plane, at, 0.5, length).distance_in(H, np.zeros((9, 9)))
    assert off.value == told.value and off.sd > told.sd


@given(slopes, slopes, st.integers(0, 7))
def test_what_the_pose_leaves_open_is_that_of_finite_differences(
    first: tuple[float, float], now: tuple[float, float], entry: int
) -> None:
    H, outline, _ = views(first, now, 0.4, 8.0, (0.0, 0.0))
    ruler = Ruler(known_plane(first, outline, 1e-9), outline.mean(axis=0), 0.0, 100.0)
    d = np.zeros(9)
    d[entry] = (1e-4, 1e-4, 1e-1, 1e-4, 1e-4, 1e-1, 1e-7, 1e-7)[entry]
    told = ruler.distance_in(H, np.outer(d, d)).sd
    nearer, farther = (ruler.distance_in(H + sign * d.reshape(3, 3), np.zeros((9, 9))).value for sign in (-1.0, 1.0))
    assert told == pytest.approx(abs(farther - nearer) / 2.0, rel=1e-2, abs=1e-4)


@given(slopes, st.floats(0.05, 0.4))
def test_it_is_only_as_sure_as_the_focal_length(tilt: tuple[float, float], sd: float) -> None:
    H, outline, _ = views(tilt, (0.1, 0.2), 0.0, 8.0, (0.0, 0.0))
    plane = known_plane(tilt, outline, sd, 1e-6, 1e-6)
    told = Ruler(plane, outline.mean(axis=0), 0.0, 1.0).distance_in(H, np.zeros((9, 9)))
    assert told.sd == pytest.approx(sd * told.value, rel=1e-3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [0.0, 1e-320, 1e-200, 1e200, 1e308, math.inf, math.nan])
@pytest.mark.parametrize("line", [slice(0, 3), slice(2, 3), slice(0, 1)])
def test_what_no_distance_follows_from_gives_none(size: float, line: slice) -> None:
    H, outline, _ = views((0.1, 0.2), (0.2, 0.1), 0.4, 8.0, (0.0, 0.0))
    ruler = Ruler(known_plane((0.1, 0.2), outline, 1e-3), outline.mean(axis=0), 0.1, 100.0)
    H[line] = np.full(3, math.copysign(size, 1.0)) if not 0.0 < size < 1e300 else H[line] * size
    for covariance in (np.zeros((9, 9)), np.eye(9), np.full((9, 9), math.nan)):
        told = ruler.distance_in(H, covariance)
        assert (math.isnan(told.value) and math.isnan(told.sd)) or (0.0 <= told.value < math.inf > told.sd >= 0.0)


@pytest.mark.slow
def test_the_axis_of_an_image_that_was_cut_is_told_by_its_calibration() -> None:
    """Of a cut image the middle is not where the optical axis is; the calibration knows."""
    scene, own = approach(5)
    cut = 60, 50  # px of the left and of the top
    K = scene.camera.matrix.copy()
    K[:2, 2] -= cut
    camera = Camera(K, size=(640 - cut[0], 480 - cut[1]))
    lens = Undistortion(camera, *camera.size)  # type: ignore[misc]
    height, width = lens.hidden.shape
    assert abs(K[0, 2] - lens.offset[0] - width / 2) <= 1.0 and abs(K[1, 2] - lens.offset[1] - height / 2) <= 1.0
    assert lens.focal == (K[0, 0] / width, 1.0)
    whole, part = (GraspTracker(length=own, camera=c) for c in (Camera(scene.camera.matrix, size=(640, 480)), camera))
    for frame in scene:
        a, b = whole.update(frame.image), part.update(np.ascontiguousarray(frame.image[cut[1] :, cut[0] :]))
        assert a.contacts is not None and b.contacts is not None
        assert b.distance == pytest.approx(a.distance, abs=0.5 * (a.distance_sd + b.distance_sd))
        assert b.tilt == pytest.approx(a.tilt, abs=0.5 * (a.tilt_sd + b.tilt_sd))
    assert b.distance_sd < 0.02 * b.distance


def test_an_axis_far_aside_is_not_taken_to_be_in_the_middle() -> None:
    assert Undistortion(Camera([[600, 0, 40.0], [0, 600, 240], [0, 0, 1]], size=(640, 480)), 640, 480).focal is None
    focal = Undistortion(Camera([[600, 0, 319.5], [0, 660, 239.5], [0, 0, 1]], size=(640, 480)), 640, 480).focal
    assert focal is not None and focal == pytest.approx((600 / 640, 1.1))


def test_the_focal_length_that_is_told_is_kept() -> None:
    class Told(Followed):
        numbers = Followed.numbers

    plane = Plane(Told(), WIDTH, HEIGHT, Beforehand.with_focal(0.7, 0.01, NUMBERS))  # type: ignore[arg-type]
    theta, covariance = plane.theta_and_covariance()
    assert theta.tolist() == [0.7, 0.0, 0.0] and covariance[0, 0] == pytest.approx(2e-4)


@given(st.floats(0.3, 3.0), st.floats(0.8, 1.2))
def test_a_calibration_tells_how_wide_pixels_are(focal: float, aspect: float) -> None:
    told = Beforehand.by_calibration((focal, aspect), NUMBERS)
    assert told is not None and math.exp(told.theta[0]) == pytest.approx(focal) and told.aspect == aspect
    assert math.sqrt(told.scale[0, 0]) == pytest.approx(NUMBERS.calibrated_sd)
    assert Beforehand.by_calibration(None, NUMBERS) is None


@pytest.mark.sampled(1)
@pytest.mark.parametrize("verb", ["track", "transfer", "inspect"])
def test_every_verb_takes_the_focal_length_of_a_calibration(
    verb: str, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever makes a state of the object knows it, and as exactly as the calibration does."""
    known: list[tuple[float, float]] = []
    begin = first_state

    def noted(
        target: Target, levels: list[Grey], focal: Beforehand | None = None, time: float | None = None
    ) -> TrackState:
        state = begin(target, levels, focal, time)
        theta, covariance = state.plane.theta_and_covariance()
        known.append((float(theta[0]), math.sqrt(covariance[0, 0])))
        return state

    monkeypatch.setattr("grasptrack.tracking.follower.first_state", noted)
    monkeypatch.setattr("grasptrack.tracking.image_pair.first_state", noted)
    scene, _ = approach(3)
    images = [str(tmp_path / f"{i}.png") for i in range(2)]
    for i, name in enumerate(images):
        cv2.imwrite(name, scene[i].image)
    (tmp_path / "c.json").write_text('{"width": 640, "height": 480, "focal": 900, "k1": 0.0}')
    given = {
        "track": [str(tmp_path / "*.png"), "--no-video"],
        "transfer": images,
        "inspect": [*images[:1], "--runs", "1"],
    }[verb]
    for calibrated in (False, True) if verb == "transfer" else (True,):
        known.clear()
        more = ["--camera", str(tmp_path / "c.json")] if calibrated else []
        assert main([verb, *given, *more, "--quiet", "--output", str(tmp_path / "o")]) == 0
        log, sd = known[-1]
        assert log == pytest.approx(math.log(900 / 640) if calibrated else 0.0, abs=0.01)
        assert (sd < 0.02) == calibrated and sd >= NUMBERS.calibrated_sd


def test_the_files_tell_it_in_each_row(tmp_path: FilePath) -> None:
    scene, _ = approach(3)
    for frame in list(scene)[:3]:
        cv2.imwrite(str(tmp_path / f"{frame.index}.png"), frame.image)
    told = {}
    for length in ("100mm", "10cm", None):
        given = [] if length is None else ["--length", length]
        assert (
            main(["track", str(tmp_path / "*.png"), *given, "-q", "--no-video", "--output", str(tmp_path / "o")]) == 0
        )
        with (tmp_path / "o" / "grasps.csv").open() as file:
            head, *rows = csv.reader(file)
        at = head.index("distance")
        assert head[at + 1] == "distance_sd"
        told[length] = [row[at : at + 2] for row in rows]
        options = json.loads((tmp_path / "o" / "run.json").read_text())["options"]
        assert options["length"] == length
    assert told[None] == [["", ""]] * 3
    mm, cm = (np.array(told[each], dtype=np.float64) for each in ("100mm", "10cm"))
    assert (mm > 0.0).all() and mm == pytest.approx(10.0 * cm, rel=1e-4)


def test_a_length_that_is_none_is_one_line(tmp_path: FilePath, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", str(tmp_path), "--length", "120px"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "--length is a length such as 120mm" in line and "120px" in line


def test_of_what_is_cut_off_no_distance_is_told() -> None:
    scene, own = approach(3)
    image = scene[0].image
    left = int(np.concatenate(scene[0].outline)[:, 0].min()) + 15
    result = GraspTracker(length=own).update(np.ascontiguousarray(image[:, left:]))
    assert result.view is not None and result.view.is_clipped
    assert math.isnan(result.distance) and math.isnan(result.distance_sd)
