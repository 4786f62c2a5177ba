# SPDX-License-Identifier: Apache-2.0
"""Cameras: GenICam's virtual ones, pylon's emulation, and stand-ins for a webcam and a RealSense; what is attached."""

import itertools
import signal
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest

import fake_devices
from grasptrack import SourceError, open_source
from grasptrack.cli.main import main
from grasptrack.errors import InputError, install_hint
from grasptrack.io import live
from grasptrack.io.base import Frame
from grasptrack.io.cameras import realsense


def first(spec: str, count: int = 3, settings: dict[str, str] | None = None) -> list[Frame]:
    return list(itertools.islice(open_source(spec, settings=settings), count))


def said(spec: str, settings: dict[str, str] | None = None) -> str:
    with pytest.raises(InputError) as caught:
        first(spec, 1, settings)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def webcam(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[fake_devices.Webcam]]:
    monkeypatch.setattr(cv2, "VideoCapture", fake_devices.Webcam)
    monkeypatch.setattr(fake_devices.Webcam, "opened", [])
    monkeypatch.setattr(live, "RETRY", 0.02)
    yield fake_devices.Webcam


def test_a_webcam_with_its_own_times(webcam: type[fake_devices.Webcam]) -> None:
    frames = first("camera:0")
    assert frames[0].image.shape == (480, 640, 3) and frames[0].name == "frame 0 of camera 0"
    steps = np.diff([f.time for f in frames]) / 0.04
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert webcam.opened[0].released


def test_settings_of_a_webcam_by_its_name_or_apart(webcam: type[fake_devices.Webcam]) -> None:
    frames = first("camera:0?size=1280x720&fps=30", settings={"exposure": "-6", "fourcc": "MJPG"})
    values = webcam.opened[0].values
    assert frames[0].image.shape == (720, 1280, 3) and values[cv2.CAP_PROP_FPS] == 30.0
    assert values[cv2.CAP_PROP_EXPOSURE] == -6 and values[cv2.CAP_PROP_FOURCC] == cv2.VideoWriter.fourcc(*"MJPG")


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ("camera:front", "named by its number"),
        ("camera:0?size=big", "size is WIDTHxHEIGHT"),
        ("camera:0?size=1920x1080", "no images of 1920x1080 px; nearest are 1280x720"),
        ("camera:0?exposure=bright", "exposure is a number"),
        ("camera:0?gain=3", "does not take gain=3"),
        ("camera:0?sharpnes=3", "has no setting sharpnes"),
        ("camera:0?fps=0", "fps is a positive number"),
        ("camera:0?30", "NAME=VALUE"),
        ("camera:3", "cannot be opened: it is missing or in use"),
    ],
)
def test_what_a_webcam_does_not_take(webcam: type[fake_devices.Webcam], spec: str, reason: str) -> None:
    assert reason in said(spec)
    assert all(camera.released for camera in webcam.opened if camera.isOpened())


def test_a_device_by_its_path(webcam: type[fake_devices.Webcam]) -> None:
    assert first("/dev/null")[0].name == "frame 0 of camera /dev/null"


def test_an_unplugged_webcam_comes_back(webcam: type[fake_devices.Webcam], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webcam, "lives", 3)
    source = open_source("camera:0")
    times = [f.time for f in itertools.islice(source, 4) if source]
    assert times == sorted(times) and len(webcam.opened) >= 2  # type: ignore[type-var]


def test_a_webcam_that_stays_away_ends_the_run_with_one_line(
    webcam: type[fake_devices.Webcam],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(webcam, "lives", 0)
    assert main(["track", "camera:0?wait=0.2", "--output", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "gave no image for 0.2 s after 0 frames: it gave no image: it may" in told


@pytest.fixture
def viky() -> Path:
    """The virtual cameras that the package genicam brings along."""
    pytest.importorskip("harvesters", reason="the extra genicam is not installed")
    found = find_spec("genicam")
    assert found is not None and found.origin is not None
    return Path(found.origin).with_name("viky.cti")


def test_a_virtual_genicam_camera(viky: Path) -> None:
    frames = first(f"genicam:{viky}#1")
    assert frames[0].image.shape == (400, 400, 3) and frames[0].time == 0.0
    grey = first(f"genicam:{viky}#1", settings={"PixelFormat": "Mono8"})
    assert grey[0].image.shape == (400, 400)
    red, green = (np.mean(first(f"genicam:{viky}#{serial}", 1)[0].image, axis=(0, 1)) for serial in (0, 1))
    assert np.argmax(red) == 2 and np.argmax(green) == 1  # they are named so


def test_a_genicam_camera_leaves_ctrl_c_to_us(viky: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    first(f"genicam:{viky}#0", 1)
    assert signal.getsignal(signal.SIGINT) is before


def test_what_a_genicam_camera_does_not_take(viky: Path, tmp_path: Path) -> None:
    assert "may mean several cameras: say which, 0, 1, 2" in said(f"genicam:{viky}")
    assert "is not attached; there is 0, 1, 2" in said(f"genicam:{viky}#9")
    assert "has no setting ExposureTim" in said(f"genicam:{viky}#0", {"ExposureTim": "1"})
    assert "does not take PixelFormat=Mono77" in said(f"genicam:{viky}#0", {"PixelFormat": "Mono77"})
    largest = said(f"genicam:{viky}#0", {"BouncingBallSize": "400"})
    assert "does not take BouncingBallSize=400" in largest and largest.endswith("Max = 40")
    assert "there is no GenTL producer" in said("genicam:/nowhere.cti#0")
    (tmp_path / "bad.cti").write_text("no library")
    assert "is no GenTL producer that can be loaded" in said(f"genicam:{tmp_path / 'bad.cti'}#0")


def test_producers_are_found_in_the_folders_of_the_environment(viky: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(viky.parent))
    assert first("genicam:#2", 1)[0].image.shape == (400, 400, 3)
    monkeypatch.delenv("GENICAM_GENTL64_PATH")
    assert "names no GenTL producer" in said("genicam:#2")


@pytest.fixture
def basler(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pypylon", reason="the extra pylon is not installed")
    monkeypatch.setenv("PYLON_CAMEMU", "2")


@pytest.mark.parametrize(
    ("form", "shape"), [("Mono8", ()), ("Mono12", ()), ("BayerRG8", (3,)), ("BayerGB12", (3,)), ("RGB8Packed", (3,))]
)
def test_an_emulated_basler_camera(basler: None, form: str, shape: tuple[int, ...]) -> None:
    settings = {"Width": "320", "Height": "240", "PixelFormat": form}
    frames = first("pylon:0815-0000", 2, settings)
    assert frames[0].image.shape == (240, 320, *shape) and frames[0].image.std() > 10
    assert frames[1].time is not None and frames[1].time > 0.0


def test_deep_images_have_the_grey_levels_of_shallow_ones(basler: None) -> None:
    size = {"Width": "256", "Height": "256", "TestImageSelector": "Testimage1"}
    shallow, deep = (first("pylon:0815-0000", 1, {**size, "PixelFormat": f})[0].image for f in ("Mono8", "Mono12"))
    assert abs(float(shallow.max()) - float(deep.max())) <= 2 and abs(float(shallow.mean()) - float(deep.mean())) <= 2


def test_what_a_basler_camera_does_not_take(basler: None) -> None:
    assert "may mean several cameras: say which, 0815-0000, 0815-0001" in said("pylon:")
    assert "is not attached; there is 0815-0000, 0815-0001" in said("pylon:40012345")
    assert "has no setting Exposure" in said("pylon:0815-0000", {"Exposure": "1"})
    assert "does not take Width=-4" in said("pylon:0815-0000", {"Width": "-4"})


@pytest.fixture
def rs(monkeypatch: pytest.MonkeyPatch) -> object:
    module = fake_devices.realsense(["831", "912"])
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    return module


def test_a_realsense_camera(rs: object) -> None:
    frames = first("realsense:831?size=1280x720&fps=30", settings={"exposure": "120"})
    assert frames[0].image.shape == (720, 1280, 3) and rs.sensors[1].options == {"exposure": 120.0}  # type: ignore[attr-defined]
    steps = np.diff([f.time for f in frames]) / 0.033
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert first("realsense:912?stream=infrared")[0].image.shape == (480, 640)


def test_what_a_realsense_camera_does_not_take(rs: object) -> None:
    assert "may mean several cameras: say which, 831, 912" in said("realsense:")
    assert "stream is color or infrared" in said("realsense:831?stream=depth")
    assert "has no setting laser_power" in said("realsense:831?laser_power=3")
    assert "does not take exposure=-1: out of range" in said("realsense:831?exposure=-1")
    assert "cannot be started: Couldn't resolve requests" in said("realsense:831?size=31x17")


def test_the_list_of_what_is_attached(
    viky: Path, basler: None, rs: object, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(viky.parent))
    assert main(["cameras"]) == 0
    told = [line.split()[0] for line in capsys.readouterr().out.splitlines() if line[0] != " "]
    assert {"pylon:0815-0000", "realsense:912", f"genicam:{viky}#0"} <= set(told)
    for spec in told:
        if spec.startswith(("pylon", "realsense")):
            assert first(spec, 1)[0].index == 0


@pytest.mark.parametrize(
    ("spec", "module", "extra"),
    [
        ("pylon:1", "pypylon.pylon", "pylon"),
        ("genicam:a.cti", "harvesters.core", "genicam"),
        ("realsense:1", "pyrealsense2", "realsense"),
        ("ros2:/image", "zenoh", "zenoh"),
    ],
)
def test_an_absent_driver_is_one_line_that_names_its_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], spec: str, module: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr("grasptrack.plugins.find_spec", lambda name: None)
    assert said(spec).endswith(install_hint(extra))
    if extra == "pylon":
        monkeypatch.setattr(realsense, "attached_realsense", list)  # its search takes two seconds
        assert main(["cameras"]) == 0
        assert f"pylon: a camera of Basler's needs pypylon: {install_hint('pylon')}" in capsys.readouterr().out


def test_settings_are_for_what_has_some(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((8, 8), np.uint8))
    with pytest.raises(SourceError, match="--set is for cameras, streams and bags"):
        open_source(tmp_path / "a.png", settings={"exposure": "1"})
    assert main(["track", str(tmp_path / "a.png"), "--set", "exposure", "--output", str(tmp_path / "o")]) == 2
