# SPDX-License-Identifier: Apache-2.0
"""A topic of a bag as a source: `bag:FILE#/topic`, or the bag's path alone where it has one topic with images."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from pathlib import Path
from typing import Any

from grasptrack.errors import GraspTrackError, SourceError
from grasptrack.io.bags.messages import MessageImages, Topic, stamp_of
from grasptrack.io.bags.readers import IMAGE_TOPIC, RESULT_TOPIC, McapFile, RosBag
from grasptrack.io.base import Image, Source

SUFFIXES = frozenset({".bag", ".mcap", ".db3"})


class BagSource(Source):
    """The images of one topic of a recording, in its order; every one of them.

    Times are s since the first image, by the headers' stamps, or those of the recording where the headers have none. A
    recording of our own gives the times that the images had.

    Args:
        spec: what the user named.
        path: of the bag.
        topic: with the images; empty where there is one only.
        fps: as for every source.
        bits: that values of 16 bits use; None takes what suits the first image.
    """

    kind = "bag"

    def __init__(self, spec: str, path: Path, topic: str, fps: float | None = None, bits: int | None = None) -> None:
        super().__init__(spec, fps)
        self._path, self._bits = path, bits
        bag = self._open_bag()
        try:
            topics = self._translate_errors(bag.topics)
            if isinstance(bag, McapFile) and any(t.name == RESULT_TOPIC for t in topics):
                self.recorded_with = bag.tracking_options()
        finally:
            bag.close()
        self._topic = _choose_topic(path, topics, topic)
        self._own = self._topic.name == IMAGE_TOPIC and any(t.name == RESULT_TOPIC for t in topics)
        self.count = self._topic.length
        self.exact = self._topic.image_form != "video"

    def _open_bag(self) -> McapFile | RosBag:
        mcap = self._path.suffix.lower() == ".mcap"
        opened: McapFile | RosBag = self._translate_errors(lambda: (McapFile if mcap else RosBag)(self._path))
        return opened

    def _translate_errors(self, work: Any) -> Any:
        """What `work` gives; whatever a reader of damaged files raises becomes one line."""
        try:
            return work()
        except GraspTrackError:
            raise
        except Exception as error:
            raise SourceError(f'bag "{self._path}" cannot be read: {_one_line(error)}', path=str(self._path)) from None

    def _read(self) -> Generator[tuple[Image, float | None, str], None, None]:
        bag, index, messages = self._open_bag(), 0, MessageImages(self._topic.image_form, self._bits)
        self.shortfall = ""
        try:
            for time, message in self._timed_messages(bag):
                name = f"image {index} of {self._topic.name}"
                image = messages.decode_message(message, name)
                if image is not None:
                    yield image, time, name
                    index += 1
        except (GraspTrackError, GeneratorExit):
            raise
        except Exception as error:
            raise SourceError(
                f'bag "{self._path}" is damaged: it can be read up to image {index} ({_one_line(error)})',
                path=str(self._path),
                frame=index,
            ) from None
        finally:
            bag.close()
        if isinstance(bag, McapFile) and not bag.is_complete:
            self.shortfall = f"it was not closed by what wrote it: {index} images could be read"
        if index == 0:
            raise SourceError(f'bag "{self._path}": no image of {self._topic.name} can be read', path=str(self._path))

    def _timed_messages(self, bag: McapFile | RosBag) -> Iterator[tuple[float | None, Any]]:
        if self._own and isinstance(bag, McapFile):
            yield from bag.timed_messages()
            return
        first: int | None = None
        stamped = True
        for recorded, message in bag.messages(self._topic.name):
            stamp = stamp_of(message)
            if first is None:
                first, stamped = (recorded, False) if stamp is None else (stamp, True)
            yield ((stamp or first if stamped else recorded) - first) / 1e9, message


def _one_line(error: Exception) -> str:
    return " ".join(f"{error}".split()) or type(error).__name__


def _choose_topic(path: Path, topics: list[Topic], asked: str) -> Topic:
    """The topic that is meant.

    Raises:
        SourceError: it is absent or no image; none was asked for, and there are several, or none.
    """
    pictures = [t for t in topics if t.image_form and t.length != 0]
    there = ", ".join(f"{t.name} ({t.length})" for t in pictures)
    if not pictures:
        names = ", ".join(sorted(t.name for t in topics)) or "none"
        raise SourceError(f'bag "{path}" holds no images; its topics: {names}', path=str(path))
    if not asked:
        if len(pictures) > 1:
            raise SourceError(f'bag "{path}" holds images of several topics, say which (bag:FILE#/topic): {there}')
        return pictures[0]
    found = next((t for t in pictures if t.name == asked or t.name == "/" + asked), None)
    if found is None:
        absent = "holds no images" if any(t.name == asked for t in topics) else "is not in it"
        raise SourceError(f'bag "{path}": topic {asked} {absent}; images are in {there}', topic=asked)
    return found


def is_bag(path: Path) -> bool:
    """Whether a path is that of a bag: a file by its suffix, a folder by what `ros2 bag` puts into it."""
    if path.is_file():
        return path.suffix.lower() in SUFFIXES
    return path.is_dir() and (path / "metadata.yaml").is_file()


def open_bag(spec: str, fps: float | None = None, settings: Mapping[str, str] | None = None) -> BagSource:
    """A topic of a bag as a source.

    Args:
        spec: ``bag:FILE#/topic``, or a path; FILE is .mcap, .bag, .db3, or the folder of a ROS 2 bag.
        fps: frames/s in place of the recording's times.
        settings: `bits`, 9 to 16: how many of 16 bits the camera used [what suits the first image].

    Raises:
        InputError: the package that reads it is not installed.
        SourceError: no bag, damaged, without images, without this topic, or with several while none is named.
    """
    text = spec.removeprefix("bag:")
    name, _, topic = text.rpartition("#") if "#" in text and not Path(text).exists() else (text, "", "")
    more = dict(settings or {})
    bits = more.pop("bits", None)
    if more:
        raise SourceError(f"a bag has no setting {next(iter(more))}, only bits", spec=spec)
    if bits is not None and not (bits.isdecimal() and 9 <= int(bits) <= 16):
        raise SourceError(f"the setting bits is 9 to 16, not {bits!r}", bits=bits)
    path = Path(name)
    if path.suffix.lower() == ".db3" and path.is_file():
        if not is_bag(path.parent):
            raise SourceError(f'"{path}" needs the metadata.yaml that ros2 bag puts beside it (ros2 bag reindex)')
        path = path.parent
    if not path.exists():
        raise SourceError(f'bag "{name}" does not exist', path=name)
    if not is_bag(path):
        kinds = ", ".join(sorted(SUFFIXES))
        raise SourceError(f'"{name}" is no bag: give a file {kinds}, or a folder with metadata.yaml', path=name)
    return BagSource(spec, path, topic, fps, None if bits is None else int(bits))
