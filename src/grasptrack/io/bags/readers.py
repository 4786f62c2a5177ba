# SPDX-License-Identifier: Apache-2.0
"""Recordings by their own libraries: MCAP files (ROS 1, ROS 2, protobuf, JSON) and bags of ROS. Extra `bags` or `foxglove`."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from grasptrack.errors import SourceError
from grasptrack.io.bags.messages import Topic
from grasptrack.plugins import import_extra

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
    """An open bag.

    Args:
        path: a file .bag, or the folder of a ROS 2 bag.
    """

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
