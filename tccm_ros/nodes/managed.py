"""Lifecycle versions of the nodes, for a lifecycle manager such as Nav2's.

configure declares parameters, loads kernels and creates publishers and services. activate
subscribes. deactivate ends the subscriptions and keeps the map. cleanup and shutdown save, as a
plain node does when it ends, and destroy everything that configure created.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

from rclpy.executors import await_or_execute
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from tccm_ros.errors import TccmError, one_line
from tccm_ros.nodes.process.ending import Ending
from tccm_ros.nodes.process.stopping import leave
from tccm_ros.nodes.run import run
from tccm_ros.nodes.sensor_node import SensorNode
from tccm_ros.nodes.slam_node import SlamNode
from tccm_ros.nodes.tccm_node import TccmNode


class ManagedNode(SensorNode, LifecycleNode):
    """A `SensorNode` whose steps are lifecycle transitions.

    Its services work while it is active; otherwise they answer that the node is not active.
    """

    _is_configuring = False

    def start_all(self) -> None:
        """Wait for the configure transition."""
        self._is_declared = self._is_configured = False
        self._kept = frozenset(vars(self)) | {"config", "_kept", "_kept_entities"}
        self._kept_entities = frozenset(id(entity) for entity, _ in self._entities())
        self._service_change_state.callback = self._refusing(self._service_change_state.callback)
        self.get_logger().info(f"unconfigured; waits for {self.get_name()}/change_state")

    # --- transitions ---

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Declare parameters, load kernels, create the processor, publishers and services."""
        return self._attempt(self._configure, "inactive; waits to be activated")

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe."""
        return self._attempt(self.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the subscriptions and process the messages received."""
        return self._attempt(self.deactivate, "inactive; the map is kept")

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Save, and destroy everything configured; Nav2's manager calls this before a shutdown."""
        return self._attempt(self._save_and_drop, "unconfigured; waits to be configured")

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Save, and destroy everything configured."""
        return self._attempt(self._save_and_drop, "finalized")

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy everything configured, so that the node can be configured again."""
        return self._attempt(self._drop, "unconfigured after an error")

    def _attempt(self, step: Callable[[], None], said: str = "") -> TransitionCallbackReturn:
        """Run a transition step and log its exception, which rclpy does not do."""
        try:
            step()
        except Exception as error:
            kind = "" if isinstance(error, TccmError) else f"{type(error).__name__}: "
            self.get_logger().error(f"{step.__name__.strip('_')} failed: {kind}{one_line(error)}")
            return TransitionCallbackReturn.ERROR
        if said:
            self.get_logger().info(said)
        return TransitionCallbackReturn.SUCCESS

    # --- steps ---

    def declare(self) -> None:
        """Declare the parameters on the first configure; later ones keep the current values."""
        if not self._is_declared:
            super().declare()
            self._is_declared = True

    def _configure(self) -> None:
        self._is_configuring = self._is_configured = True
        try:
            self.configure()
        finally:
            self._is_configuring = False
        self.kernels.load()

    def activate(self) -> None:
        """Subscribe, and log the known sensors and silent inputs."""
        super().activate()
        self.log_ready()

    def save_quickly(self, ending: Ending) -> None:
        """Save the newest result if the node is configured."""
        if self._is_configured:
            super().save_quickly(ending)

    def close(self, ending: Ending | None = None) -> None:
        """Save if the node is configured and saving is enabled."""
        if self._is_configured:
            super().close(ending)

    def _save_and_drop(self) -> None:
        if self._is_configured:
            if self.is_active:
                self.deactivate()
            self.close()
            self._drop()

    def _drop(self) -> None:
        """Destroy everything that configure created, also after it failed half-way."""
        self.is_active = self._is_configured = False
        with suppress(AttributeError):  # after a configure that failed half-way
            self.kernels.stop()
            self.intake.stop()
            self.unsubscribe()
            self.worker.close()
        self.release()
        for entity, destroy in list(self._entities()):
            if id(entity) not in self._kept_entities:
                destroy(entity)
        for name in set(vars(self)) - self._kept:
            delattr(self, name)

    def _entities(self) -> Iterator[tuple[Any, Callable[[Any], Any]]]:
        yield from ((publisher, self.destroy_publisher) for publisher in self.publishers)
        yield from ((service, self.destroy_service) for service in self.services)
        yield from ((timer, self.destroy_timer) for timer in self.timers)

    def interrupt(self) -> None:
        """End the process while it loads kernels, where signals are not handled."""
        if self._is_configured and self.is_loading:
            self.kernels.stop()
            leave(0)

    def destroy_node(self) -> None:
        """Destroy the node and its state machine, which rclpy leaves alive."""
        self._drop()
        LifecycleNode.destroy_node(self)
        self._state_machine.destroy_when_not_in_use()

    # --- services ---

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **options: Any) -> Any:
        """Create a service; one created by configure works only while the node is active."""
        if self._is_configuring:
            callback = self._while_active(callback)
        return super().create_service(srv_type, srv_name, callback, **options)

    def _while_active(self, callback: Any) -> Any:
        async def answer(request: Any, response: Any) -> Any:
            if self.is_active:
                return await await_or_execute(callback, request, response)
            response.success = False
            response.message = f"{self.get_name()} is not active; have it activated"
            return response

        return answer

    def _refusing(self, callback: Any) -> Any:
        """Return a change_state callback that refuses transitions that are not possible now.

        Without it, rclpy would end the node.
        """

        def change(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except _rclpy.RCLError:
                name = request.transition.label or request.transition.id
                state = self._state_machine.current_state[1]
                self.get_logger().error(f"transition {name} is not possible while {state}")
                response.success = False
                return response

        return change


class ManagedTccmNode(ManagedNode, TccmNode):
    """tccm_node as a lifecycle node."""


class ManagedSlamNode(ManagedNode, SlamNode):
    """slam_node as a lifecycle node."""


def main_tccm() -> None:
    """Run `ManagedTccmNode` until it is asked to stop."""
    run(ManagedTccmNode)


def main_slam() -> None:
    """Run `ManagedSlamNode` until it is asked to stop."""
    run(ManagedSlamNode)
