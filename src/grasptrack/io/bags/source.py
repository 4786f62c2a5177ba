# SPDX-License-Identifier: Apache-2.0
"""A topic of a bag as a source: `bag:FILE#/topic`, or the bag's path alone where it has one topic with images.

Recordings are read by their own libraries: MCAP files (ROS 1, ROS 2, protobuf, JSON), bags of ROS. Extra `bags` or `foxglove`.
"""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Callable, Generator, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from grasptrack.errors import GraspTrackError, SourceError
from grasptrack.io.bags.messages import MessageImages, Topic, stamp_of
from grasptrack.io.base import Image, Source
from grasptrack.plugins import import_extra

SUFFIXES = frozenset({".bag", ".mcap", ".db3"})
_STORED = frozenset({".mcap", ".db3", ".bag", ".zstd", ".yaml"})
"""Suffixes of what a folder that is a bag consists of."""


class BagSource(Source):
    """The images of one topic of a recording, in its order; every one of them.

    Times are s since the first image, by the headers' stamps, or those of the recording where the headers have none. A
    recording of our own gives the times that the images had.

    Args:
        spec: what the user named.
        path: of the bag.
        topic: with the images; empty where there is one only.
        bits: that values of 16 bits use; None takes what suits the first image.
    """

    kind = "bag"

    def __init__(self, spec: str, path: Path, topic: str, fps: float | None = None, bits: int | None = None) -> None:
        super().__init__(spec, fps)
        self._path, self._bits = path, bits
        stored = [p for p in path.iterdir() if p.suffix in _STORED] if path.is_dir() else [path]
        self.files = tuple(sorted(stored))
        bag = self._open_bag()
        try:
            topics = self._translate_errors(bag.topics)
            self._topic = chosen = _choose_topic(path, topics, topic)
            if isinstance(bag, McapFile):
                self._translate_errors(lambda: bag.prepare_topic(chosen.name))
                if any(t.name == RESULT_TOPIC for t in topics):
                    self.recorded_with = bag.tracking_options()
        finally:
            bag.close()
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

    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
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
    """The topic that is meant."""
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


RESULT_TOPIC = "/grasptrack/result"
"""Where our own recordings tell each image's time as it was, to the last digit, or that it had none."""
IMAGE_TOPIC = "/grasptrack/image"
METADATA = "grasptrack"
"""Name of the record in which our own recordings keep how they were tracked."""
_MAGIC = b"\x89MCAP0\r\n"
"""At both ends of a file."""


class McapFile:
    """An open MCAP file."""

    def __init__(self, path: Path) -> None:
        reader = import_extra("mcap.reader", "bags", "an MCAP file")
        self._path = path
        self._file = path.open("rb")
        try:
            self._reader: Any = reader.make_reader(self._file)
            self._summary = self._read_summary()
        except BaseException:
            self._file.close()
            raise
        self._decoders: dict[int, Callable[[bytes], Any]] = {}

    def _read_summary(self) -> Any:
        """The index at the file's end; None where its writer was killed before there was one, or the file was cut off."""
        if self._file.seek(0, os.SEEK_END) > len(_MAGIC):
            self._file.seek(-len(_MAGIC), os.SEEK_END)
            if self._file.read() != _MAGIC:
                return None
        self._file.seek(0)
        summary = self._reader.get_summary()
        return summary if summary is not None and summary.statistics else None

    @property
    def is_complete(self) -> bool:
        """Whether its writer ended it."""
        return self._summary is not None

    def topics(self) -> list[Topic]:
        """All topics; of a file without an index, those of its messages, which are read for this."""
        if self._summary is not None:
            counts = self._summary.statistics.channel_message_counts
            schemas, channels = self._summary.schemas, self._summary.channels
            return [
                Topic(c.topic, schemas[c.schema_id].name if c.schema_id else "", counts.get(c.id, 0))
                for c in channels.values()
            ]
        found: dict[str, Topic] = {}
        for schema, channel, _ in self._iterate_messages(None):
            before = found.get(channel.topic)
            found[channel.topic] = Topic(
                channel.topic, schema.name if schema else "", 1 + (before.length or 0 if before else 0)
            )
        return list(found.values())

    def tracking_options(self) -> str:
        """Options of `grasptrack track` that track our own recording again alike; empty where it tells none."""
        self._file.seek(0)
        reader = self._reader
        if self._summary is None:
            reader = import_extra("mcap.reader", "bags", "an MCAP file").NonSeekingReader(self._file)
        try:
            records = (record for record in reader.iter_metadata() if record.name == METADATA)
            return str(next(records).metadata.get("options", ""))
        except Exception:  # there is none, or the file ends somewhere within a record
            return ""

    def _iterate_messages(self, topics: list[str] | None) -> Iterator[tuple[Any, Any, Any]]:
        """Messages in the order of their times, or of the file where it has no index; up to where a file was cut off."""
        if self._summary is not None:
            yield from self._reader.iter_messages(topics=topics)
            return
        self._file.seek(0)
        reader = import_extra("mcap.reader", "bags", "an MCAP file").NonSeekingReader(self._file)
        try:
            yield from reader.iter_messages(topics=topics, log_time_order=False)
        except Exception:  # the file ends somewhere within a record, which the reader meets in many ways
            return

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Times of recording in ns and messages, in that order."""
        for schema, channel, message in self._iterate_messages([topic]):
            yield message.log_time, self._decoder_for(schema, channel)(message.data)

    def timed_messages(self) -> Iterator[tuple[float | None, Any]]:
        """Images of our own recording with the times, in s, that they had; None for none."""
        held: Any = None
        for schema, channel, message in self._iterate_messages([IMAGE_TOPIC, RESULT_TOPIC]):
            if channel.topic == IMAGE_TOPIC:
                held = message.log_time, self._decoder_for(schema, channel)(message.data)
            elif held is not None and held[0] == message.log_time:
                time = json.loads(message.data).get("time_s")
                yield time, held[1]
                held = None

    def prepare_topic(self, name: str) -> None:
        """Raise what its messages cannot be read without, before one is asked for; a file without an index tells later."""
        if self._summary is not None:
            for channel in self._summary.channels.values():
                if channel.topic == name:
                    self._decoder_for(self._summary.schemas.get(channel.schema_id), channel)

    def _decoder_for(self, schema: Any, channel: Any) -> Callable[[bytes], Any]:
        decoder = self._decoders.get(channel.id)
        if decoder is None:
            decoder = self._decoders[channel.id] = _make_decoder(schema, channel, self._path)
        return decoder

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _make_decoder(schema: Any, channel: Any, path: Path) -> Callable[[bytes], Any]:
    encoding = channel.message_encoding
    if encoding == "json":
        return lambda data: json.loads(data, object_hook=_with_bytes)
    if encoding == "protobuf":
        module = import_extra("mcap_protobuf.decoder", "foxglove", "an MCAP file of Foxglove")
        found: Callable[[bytes], Any] = module.DecoderFactory().decoder_for(encoding, schema)
        return found
    if encoding in ("cdr", "ros1") and schema is not None:
        typesys = import_extra("rosbags.typesys", "bags", "an MCAP file of ROS")
        name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
        text = schema.data.decode("utf-8")
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        known = typesys.get_types_from_idl if schema.encoding == "ros2idl" else typesys.get_types_from_msg
        store.register(known(text) if schema.encoding == "ros2idl" else known(text, name))
        read = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
        return lambda data: read(data, name)
    raise SourceError(f'"{path}": messages of {channel.topic} are in "{encoding}", which is not read', path=str(path))


def _with_bytes(fields: dict[str, Any]) -> SimpleNamespace:
    """A JSON object as attributes; Foxglove has data in base64 there."""
    if isinstance(fields.get("data"), str):
        fields["data"] = base64.b64decode(fields["data"])
    return SimpleNamespace(**fields)


class RosBag:
    """An open bag: a file .bag, or the folder of a ROS 2 bag."""

    def __init__(self, path: Path) -> None:
        highlevel = import_extra("rosbags.highlevel", "bags", "a bag of ROS")
        typesys = import_extra("rosbags.typesys", "bags", "a bag of ROS")
        # Bags of ROS 2 before Iron hold no definitions; those of images are the same in all.
        known = typesys.get_typestore(typesys.Stores.LATEST)
        self._reader: Any = highlevel.AnyReader([path], default_typestore=known)
        self._reader.open()

    def topics(self) -> list[Topic]:
        """All topics."""
        return [Topic(name, info.msgtype or "", info.msgcount) for name, info in self._reader.topics.items()]

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Times of recording in ns and messages, in that order."""
        chosen = [c for c in self._reader.connections if c.topic == topic]
        for connection, time, data in self._reader.messages(connections=chosen):
            yield time, self._reader.deserialize(data, connection.msgtype)

    def close(self) -> None:
        """Close the files."""
        self._reader.close()
