# SPDX-License-Identifier: Apache-2.0
"""As much of ROS 2 as the nodes of ros/ use, in one process: messages that go through CDR, a clock that is set by hand.

Messages have the fields, defaults and checks of types of rclpy's; what is published goes through CDR as rosbags writes it.
"""

from __future__ import annotations

import enum
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROS = Path(__file__).resolve().parents[2] / "ros"
POINT2, COLOR = "float64 x\nfloat64 y\n", "float64 r\nfloat64 g\nfloat64 b\nfloat64 a\n"
STAMP = "builtin_interfaces/Time timestamp\n"
DEFINITIONS = {
    "foxglove_msgs/msg/Point2": POINT2,
    "foxglove_msgs/msg/Color": COLOR,
    "foxglove_msgs/msg/CircleAnnotation": STAMP + "Point2 position\nfloat64 diameter\nfloat64 thickness\n"
    "Color fill_color\nColor outline_color\n",
    "foxglove_msgs/msg/PointsAnnotation": STAMP + "uint8 type\nPoint2[] points\nColor outline_color\n"
    "Color[] outline_colors\nColor fill_color\nfloat64 thickness\n",
    "foxglove_msgs/msg/TextAnnotation": STAMP + "Point2 position\nstring text\nfloat64 font_size\n"
    "Color text_color\nColor background_color\n",
    "foxglove_msgs/msg/ImageAnnotations": "CircleAnnotation[] circles\nPointsAnnotation[] points\nTextAnnotation[] texts\n",
    "vision_msgs/msg/Point2D": POINT2,
    "vision_msgs/msg/Pose2D": "Point2D position\nfloat64 theta\n",
    "vision_msgs/msg/BoundingBox2D": "Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    "vision_msgs/msg/Detection2D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
    "BoundingBox2D bbox\nstring id\n",
    "vision_msgs/msg/Detection2DArray": "std_msgs/Header header\nDetection2D[] detections\n",
    "rcl_interfaces/msg/ParameterDescriptor": "string name\nbool dynamic_typing\n",
    **{f"grasptrack_msgs/msg/{p.stem}": p.read_text() for p in sorted((ROS / "grasptrack_msgs" / "msg").glob("*.msg"))},
}
"""As their packages define them; descriptors only with what is used."""


def typestore() -> Any:
    """ROS 2 Humble's types, and those above."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    found = {}
    for name, text in DEFINITIONS.items():
        found.update(get_types_from_msg(text, name))
    store.register({name: what for name, what in found.items() if name not in store.fielddefs})
    return store


# --- messages --------------------------------------------------------------------------------------


class Messages:
    """Classes of messages by name, and their way through CDR."""

    def __init__(self) -> None:
        self.store = typestore()
        self._known: dict[str, type] = {}

    def kind(self, name: str) -> type:
        """The class of a type, as std_msgs/msg/Header."""
        if name not in self._known:
            constants, fields = self.store.fielddefs[name]
            content = {"_name": name, "_fields": dict(fields), "_of": self}
            content.update({constant: value for constant, _kind, value in constants})
            self._known[name] = type(name.rpartition("/")[2], (_Message,), content)
        return self._known[name]

    def default(self, node: Any) -> Any:
        """Of a field."""
        kind, what = node[0].name, node[1]
        if kind == "NAME":
            return self.kind(what)()
        if kind == "SEQUENCE":
            return []
        if kind == "ARRAY":
            return [self.default(what[0]) for _ in range(what[1])]
        return {"bool": False, "string": "", "byte": b"\0"}.get(what[0], 0.0 if what[0].startswith("float") else 0)

    def check(self, name: str, node: Any, value: Any) -> None:
        """As rclpy's setters do, and says which field it is."""
        kind, what = node[0].name, node[1]
        if kind == "NAME":
            good = isinstance(value, self.kind(what))
        elif kind in ("SEQUENCE", "ARRAY"):
            good = isinstance(value, (list, tuple, bytes, np.ndarray)) and (kind == "SEQUENCE" or len(value) == what[1])
            if good and not isinstance(value, (bytes, np.ndarray)):
                for part in value:
                    self.check(name, what[0], part)
        elif what[0] == "bool":
            good = isinstance(value, bool)
        elif what[0] == "string":
            good = isinstance(value, str)
        elif what[0] == "byte":
            good = isinstance(value, bytes) and len(value) == 1
        elif what[0].startswith("float"):
            good = isinstance(value, float)
        else:
            good = (
                isinstance(value, int) and not isinstance(value, bool) and (value >= 0 or not what[0].startswith("u"))
            )
        assert good, f"{name} cannot be {value!r} ({type(value).__name__})"

    def plain(self, node: Any, value: Any) -> Any:
        """A field as rosbags wants it."""
        kind, what = node[0].name, node[1]
        if kind == "NAME":
            fields = {n: self.plain(node, getattr(value, n)) for n, node in value._fields.items()}
            return self.store.types[what](**fields)
        if kind in ("SEQUENCE", "ARRAY"):
            if what[0][0].name == "BASE" and what[0][1][0] not in ("string",):
                data = list(value) if isinstance(value, bytes) else value
                return np.array(data, dtype={"byte": "uint8"}.get(what[0][1][0], what[0][1][0]))
            return [self.plain(what[0], part) for part in value]
        return value[0] if what[0] == "byte" else value

    def through_cdr(self, message: Any) -> Any:
        """The message as a subscriber gets it."""
        node = (types.SimpleNamespace(name="NAME"), message._name)
        data = self.store.serialize_cdr(self.plain(node, message), message._name)
        return self.received(message._name, self.store.deserialize_cdr(bytes(data), message._name))

    def received(self, name: str, plain: Any) -> Any:
        """A message of rosbags as one of a class of `kind`."""
        out = self.kind(name)()
        for field, (kind, what) in out._fields.items():
            value = getattr(plain, field)
            if kind.name == "NAME":
                value = self.received(what, value)
            elif kind.name in ("SEQUENCE", "ARRAY") and what[0][0].name == "NAME":
                value = [self.received(what[0][1], part) for part in value]
            object.__setattr__(out, field, value)
        return out


class _Message:
    _name: str
    _fields: dict[str, Any]
    _of: Messages

    def __init__(self, **fields: Any) -> None:
        for name, node in self._fields.items():
            object.__setattr__(self, name, self._of.default(node))
        for name, value in fields.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        assert name in self._fields, f"{self._name} has no field {name}"
        self._of.check(f"{self._name}.{name}", self._fields[name], value)
        object.__setattr__(self, name, value)


# --- nodes -----------------------------------------------------------------------------------------


class Publisher:
    """Keeps what it is given, as a subscriber gets it; nothing while its node is not active."""

    def __init__(self, world: World, kind: type, topic: str, qos: Any) -> None:
        self.world, self.kind, self.topic, self.qos = world, kind, topic, qos
        self.sent: list[Any] = []
        self.active = False
        self.listeners = 1

    def publish(self, message: Any) -> None:
        assert type(message) is self.kind, (self.topic, type(message))
        assert self.world.up, "the connection is closed"
        if self.active:
            self.sent.append(self.world.messages.through_cdr(message))

    def get_subscription_count(self) -> int:
        return self.listeners


class Logger:
    """Keeps what is said."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def _say(self, level: str, text: str) -> None:
        self.lines.append((level, text))

    def info(self, text: str, **_: Any) -> None:
        self._say("info", text)

    def warning(self, text: str, **_: Any) -> None:
        self._say("warning", text)

    def error(self, text: str, **_: Any) -> None:
        self._say("error", text)


class Reply(enum.Enum):
    """What a transition gives."""

    SUCCESS, FAILURE, ERROR = range(3)


class Node:
    """A lifecycle node."""

    world: World

    def __init__(self, name: str) -> None:
        self._name, self._logger = name, Logger()
        self.told: dict[str, Any] = {}
        self.publishers: dict[str, Publisher] = {}
        self.subscriptions: dict[str, tuple[type, Callable[[Any], None], Any]] = {}
        self.services: dict[str, tuple[Any, Callable[[Any, Any], Any]]] = {}
        self.timers: list[Callable[[], None]] = []
        self.actions: list[str] = []
        self.world.nodes.append(self)

    def get_name(self) -> str:
        return self._name

    def get_logger(self) -> Logger:
        return self._logger

    def get_clock(self) -> Any:
        return self.world.clock

    def has_parameter(self, name: str) -> bool:
        return name in self.told

    def declare_parameter(self, name: str, value: Any = None, descriptor: Any = None) -> None:
        dynamic = descriptor is not None and descriptor.dynamic_typing
        own = self.world.parameters.get(name, value)
        assert dynamic or (value is not None and type(own) is type(value)), f"parameter {name}: {own!r}"
        self.told[name] = own

    def get_parameter(self, name: str) -> Any:
        return types.SimpleNamespace(value=self.told[name])

    def create_lifecycle_publisher(self, kind: type, topic: str, qos: Any) -> Publisher:
        self.publishers[topic] = Publisher(self.world, kind, topic, qos)
        return self.publishers[topic]

    def create_publisher(self, kind: type, topic: str, qos: Any) -> Publisher:
        publisher = self.create_lifecycle_publisher(kind, topic, qos)
        publisher.active = True
        return publisher

    def create_subscription(self, kind: type, topic: str, callback: Callable[[Any], None], qos: Any) -> str:
        self.subscriptions[topic] = (kind, callback, qos)
        return topic

    def create_service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> str:
        self.services[name] = (kind, callback)
        return name

    def create_timer(self, period: float, callback: Callable[[], None]) -> Callable[[], None]:
        assert period > 0.0
        self.timers.append(callback)
        return callback

    def destroy_timer(self, timer: Callable[[], None]) -> None:
        self.timers.remove(timer)

    def destroy_subscription(self, topic: str) -> None:
        del self.subscriptions[topic]

    def destroy_service(self, name: str) -> None:
        del self.services[name]

    def destroy_lifecycle_publisher(self, publisher: Publisher) -> None:
        del self.publishers[publisher.topic]

    def destroy_node(self) -> None:
        assert self.world.up, "the connection is closed"
        self.world.nodes.remove(self)

    def on_activate(self, state: Any) -> Reply:
        for publisher in self.publishers.values():
            publisher.active = True
        return Reply.SUCCESS

    def on_deactivate(self, state: Any) -> Reply:
        for publisher in self.publishers.values():
            publisher.active = False
        return Reply.SUCCESS

    # what a test does

    def change(self, transition: str) -> Reply:
        """A transition as configure, and what follows an error in it; as rclpy, it keeps the error to itself."""
        try:
            reply = getattr(self, f"on_{transition}")(None)
        except Exception:
            reply = Reply.ERROR
        if reply is Reply.ERROR:
            assert self.on_error(None) is Reply.SUCCESS
        return reply

    @property
    def open_things(self) -> list[Any]:
        """What a node leaves behind that is not cleaned up."""
        return [*self.publishers, *self.subscriptions, *self.services, *self.timers, *self.actions]

    def receive(self, topic: str, message: Any) -> None:
        """A message arrives, through CDR, as the class that was asked for."""
        kind, callback, _ = self.subscriptions[topic]
        assert type(message) is kind, (topic, type(message))
        callback(self.world.messages.through_cdr(message))

    def call(self, name: str, **request: Any) -> Any:
        """A service is called."""
        kind, callback = self.services[name]
        return callback(types.SimpleNamespace(**request), kind.Response())


class Clock:
    """Set by hand."""

    def __init__(self, messages: Messages) -> None:
        self.nanoseconds, self._messages = 1_700_000_000_000_000_000, messages

    def now(self) -> Clock:
        return self

    def to_msg(self) -> Any:
        return self.stamp(self.nanoseconds)

    def stamp(self, ns: int) -> Any:
        """A builtin_interfaces/Time."""
        return self._messages.kind("builtin_interfaces/msg/Time")(sec=ns // 1_000_000_000, nanosec=ns % 1_000_000_000)


class World:
    """Everything; `install` makes it importable."""

    def __init__(self) -> None:
        self.messages = Messages()
        self.clock = Clock(self.messages)
        self.parameters: dict[str, Any] = {}
        self.nodes: list[Node] = []
        self.transform: Any = None
        self.transform_ns = 0
        self.goals: list[Any] = []
        self.gripper = types.SimpleNamespace(ready=True, accepted=True, stalled=True, position=0.0)
        self.up = True
        self.spin: Callable[[], None] = lambda: None

    def make(self, name: str, **fields: Any) -> Any:
        """A message of a type, as sensor_msgs/Image."""
        package, _, kind = name.partition("/")
        return self.messages.kind(f"{package}/msg/{kind}")(**fields)

    def refused_by(self, kind: Callable[[], Any], parameters: dict[str, Any]) -> str:
        """The one line of a node that does not take its parameters, and leaves nothing behind."""
        self.parameters.update(parameters)
        node = kind()
        assert node.change("configure") is Reply.FAILURE and not node.open_things
        ((level, text),) = node.get_logger().lines
        assert level == "error" and "\n" not in text
        return text

    def install(self, monkeypatch: Any) -> None:
        """Modules under the names of ROS, and ros/ on the path, for one test."""
        monkeypatch.syspath_prepend(str(ROS / "grasptrack_ros"))
        for name in [n for n in sys.modules if n.split(".")[0] == "grasptrack_ros"]:
            monkeypatch.delitem(sys.modules, name)
        packages: dict[str, dict[str, type]] = {}
        for name in self.messages.store.fielddefs:
            package, _, kind = name.split("/")
            packages.setdefault(package, {})[kind] = self.messages.kind(name)
        for package, kinds in packages.items():
            self._module(monkeypatch, package)
            self._module(monkeypatch, f"{package}.msg", **kinds)
        reply = types.SimpleNamespace
        service = reply(Request=reply, Response=lambda: reply(success=False, message=""))
        self._module(monkeypatch, "std_srvs")
        self._module(monkeypatch, "std_srvs.srv", Trigger=service, SetBool=service)
        self._module(monkeypatch, "grasptrack_msgs.srv", Click=service)
        command = reply(Goal=lambda: reply(command=reply(position=0.0, max_effort=0.0)))
        self._module(monkeypatch, "control_msgs")
        self._module(monkeypatch, "control_msgs.action", GripperCommand=command)
        world = self

        class Buffer:
            def lookup_transform(self, target: str, source: str, time: Any) -> Any:
                if world.transform is None:
                    raise LookupError(f'"{source}" does not exist')
                header = reply(stamp=world.clock.stamp(world.transform_ns))
                return reply(transform=world.transform, header=header)

        class TransformListener:
            def __init__(self, buffer: Buffer, node: Node) -> None:
                self.node = node
                node.subscriptions["/tf"] = (object, lambda message: None, None)

            def unregister(self) -> None:
                self.node.destroy_subscription("/tf")

        class ActionClient:
            def __init__(self, node: Node, kind: Any, name: str) -> None:
                self.node, self.name = node, name
                node.actions.append(name)

            def server_is_ready(self) -> bool:
                return bool(world.gripper.ready)

            def send_goal_async(self, goal: Any) -> Any:
                world.goals.append(goal)
                done = reply(result=lambda: reply(result=world.gripper))
                result = reply(add_done_callback=lambda f: f(done))
                handle = reply(accepted=world.gripper.accepted, get_result_async=lambda: result)
                return reply(add_done_callback=lambda f: f(reply(result=lambda: handle)))

            def destroy(self) -> None:
                self.node.actions.remove(self.name)

        class Executor:
            def add_node(self, node: Node) -> None:
                assert node in world.nodes

            def spin_once(self, timeout_sec: float) -> None:
                world.spin()

        def shut_down() -> None:
            world.up = False

        tf = {"Buffer": Buffer, "TransformListener": TransformListener, "TransformException": LookupError}
        self._module(monkeypatch, "tf2_ros", **tf)
        node = type("LifecycleNode", (Node,), {"world": self})
        self._module(monkeypatch, "rclpy.node", Node=type("PlainNode", (Node,), {"world": self}))
        life = {"LifecycleNode": node, "LifecycleState": object, "TransitionCallbackReturn": Reply}
        reliability = enum.Enum("Reliability", "BEST_EFFORT RELIABLE")
        self._module(monkeypatch, "rclpy", init=reply, ok=lambda: world.up, try_shutdown=shut_down)
        self._module(monkeypatch, "rclpy.action", ActionClient=ActionClient)
        self._module(monkeypatch, "rclpy.executors", SingleThreadedExecutor=Executor)
        self._module(monkeypatch, "rclpy.lifecycle", **life)
        self._module(monkeypatch, "rclpy.qos", QoSProfile=reply, ReliabilityPolicy=reliability)
        self._module(monkeypatch, "rclpy.signals", SignalHandlerOptions=enum.Enum("Signals", "ALL NO"))
        stamp = self.clock.stamp
        time = lambda nanoseconds=0: reply(to_msg=lambda: stamp(nanoseconds))  # noqa: E731
        self._module(monkeypatch, "rclpy.time", Time=time)

    @staticmethod
    def _module(monkeypatch: Any, name: str, **content: Any) -> None:
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
