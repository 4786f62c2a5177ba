# SPDX-License-Identifier: Apache-2.0
"""What both nodes share: what is opened is closed again, and whatever goes wrong ends at rest, Ctrl-C included."""

from __future__ import annotations

import contextlib
import functools
import signal
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from grasptrack_ros.parameters import declare_parameters

RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
WAIT = 0.1
"""s at most until Ctrl-C is seen, and in which the last messages go out."""


class ManagedNode(LifecycleNode):
    """A lifecycle node that opens with `open`, comes to rest with `rest`, and leaves nothing behind.

    Args:
        name: of the node.
        kinds: data classes of its parameters.
    """

    def __init__(self, name: str, *kinds: type) -> None:
        super().__init__(name)
        self.opened = contextlib.ExitStack()
        for kind in kinds:
            declare_parameters(self, kind)

    def open(self) -> None:
        """Read the parameters, open topics and services; what is opened is noted in `opened`."""
        raise NotImplementedError

    def rest(self, why: str = "") -> None:
        """Come to rest, for good where something went wrong (`why`); may be called in any state."""

    # --- states -----------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open; where that does not succeed, nothing stays open."""
        try:
            self.open()
        except Exception as error:
            self.opened.close()
            self.get_logger().error(_told(error))
            return FAILURE
        return SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Rest; while the publishers can still say so."""
        self.rest()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Rest, close everything."""
        try:
            self.rest()
        finally:
            self.opened.close()
        return SUCCESS

    on_shutdown = on_cleanup

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """A transition failed: rest, close everything; it can be configured again."""
        self.get_logger().error("a transition failed: the node begins anew, unconfigured")
        return self.on_cleanup(state)

    # --- parts ------------------------------------------------------------------------------------

    def publisher(self, kind: type, topic: str, qos: Any = RELIABLE) -> Any:
        """A publisher that is silent while the node is not active."""
        made = self.create_lifecycle_publisher(kind, topic, qos)
        self.opened.callback(self.destroy_lifecycle_publisher, made)
        return made

    def listen(self, kind: type, topic: str, callback: Callable[[Any], None], qos: Any = RELIABLE) -> None:
        """A subscription."""
        self.opened.callback(self.destroy_subscription, self.create_subscription(kind, topic, callback, qos))

    def serve(self, kind: type, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """A service."""
        self.opened.callback(self.destroy_service, self.create_service(kind, name, callback))


def guarded(callback: Callable[..., Any]) -> Callable[..., Any]:
    """A callback of a node: what goes wrong in it is told, to who called a service too, and the node comes to rest."""

    @functools.wraps(callback)
    def run(node: ManagedNode, *told: Any) -> Any:
        try:
            return callback(node, *told)
        except Exception as error:
            node.get_logger().error(_told(error))
            node.rest(_told(error))
            answer = told[-1] if told else None
            if hasattr(answer, "success"):
                answer.success, answer.message = False, _told(error)
            return answer

    return run


def _told(error: Exception) -> str:
    """A line."""
    return " ".join((str(error) or type(error).__name__).split())


def run(kind: Callable[[], ManagedNode]) -> None:
    """Run a node until Ctrl-C or SIGTERM; it comes to rest while its messages still go out."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # rclpy's own would close the connection first
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    node = kind()
    try:
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while rclpy.ok():
            executor.spin_once(timeout_sec=WAIT)
    except KeyboardInterrupt:
        pass
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):  # launch and the terminal send one each
            signal.signal(number, signal.SIG_IGN)
        node.rest()
        time.sleep(WAIT)
        node.destroy_node()
        rclpy.try_shutdown()
