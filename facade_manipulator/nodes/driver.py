"""
The driver node: parameters, messages and requests of the control loop in its own process.

A managed node: configure brings the bus up and checks the drives, activate powers them on. A stop
of the drives makes it inactive; the end of the control loop makes it unconfigured, and the next
configure starts another loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib import import_module
from importlib.metadata import version
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from facade_manipulator import topics
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.control_loop import LoopSetup
from facade_manipulator.control_loop.process import LoopClient, start_process
from facade_manipulator.drives.axis_settings import read_axes
from facade_manipulator.drives.controller import STATES_RATE
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.profile import profile_checksums
from facade_manipulator.drives.snapshot import ControllerSnapshot
from facade_manipulator.drives.stopping import StoppingAnalysis
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.messages import carriages_from, seconds
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.nodes import driver_diagnostics
from facade_manipulator.nodes.clock import ros_time, steady_timer
from facade_manipulator.nodes.conversions import joint_state
from facade_manipulator.nodes.diagnostics import DiagnosticsPublisher, Rejections
from facade_manipulator.nodes.driver_requests import DriverRequests
from facade_manipulator.nodes.lifecycle import ManagedNode, offer_later
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.nodes.publisher_watch import PublisherWatch
from facade_manipulator.nodes.run import run
from facade_manipulator.nodes.software_stop import SoftwareStop
from facade_manipulator.parameters import parameter, settings

SUPERVISION_PERIOD = 0.02  # s
STOPPED_STATES = (ControllerState.STOPPED, ControllerState.LOST)


@settings
class DriverSettings:
    """Settings of the driver node, beside those of the controller."""

    simulate_drives: bool = parameter(
        'Whether the driver starts simulated drives on its own virtual bus', default=False)
    configure_at_start: bool = parameter(
        'Whether the driver configures itself when it starts; it never powers the drives',
        default=False)
    software_stop_timeout: float = parameter(
        'Silence of software_stop, once received, that stops the drives and forbids power',
        default=0.5, unit='s', minimum=0.05, maximum=10.0)
    software_stop_topics: tuple[str, ...] = parameter(
        'Topics on which supervisors forbid power, one for each of them',
        default=('software_stop',))


class DriverNode(ManagedNode):
    """
    ROS side of the control loop.

    Parameters
    ----------
    launch : callable
        Starts the process of the loop; see `facade_manipulator.control_loop.process.LoopClient`.

    """

    def __init__(self, launch: Callable[..., Any] = start_process, **kwargs: Any) -> None:
        super().__init__('driver', **kwargs)
        self._settings = declare(self, DriverSettings)
        self._setup = self._declare_setup()
        self._version = version('facade_manipulator')
        self._profiles = profile_checksums(axis.profile for axis in self._setup.axes)
        self.rejections = Rejections(self)
        self._loop = LoopClient(
            self._setup, lambda *error: self.rejections.add(InputError(*error)), launch)
        self._published_stamp: float | None = None
        self._drive_faults, self._was_stopped = 0, False

        self._joint_states = self.create_publisher(*topics.JOINT_STATES)
        self._status = driver_diagnostics.StatusPublisher(
            self.create_publisher(*topics.DRIVER_STATUS).publish)
        self._diagnostics = DiagnosticsPublisher(self, self.rejections, self._components)
        self._inputs = PublisherWatch(self, self.rejections, self._apply_software_stop)
        self._inputs.subscribe(topics.JOINT_SETPOINTS, self._receive_setpoint)
        if self._settings.simulate_drives:
            self._inputs.subscribe(topics.CARRIAGE_FORCES, self._receive_forces)
        stop_topics = self._settings.software_stop_topics
        self._software_stop = SoftwareStop(
            stop_topics, self._settings.software_stop_timeout, self._inputs.fault_of)
        for name in stop_topics:
            receive = partial(self._receive_stop, name)
            self._inputs.subscribe(topics.SOFTWARE_STOP._replace(name=name), receive, receive)
        self._requests = DriverRequests(
            self, self._loop, self._software_stop, self._apply_software_stop)
        self.transitions = self._requests.transitions
        self.offer_job(topics.HOME, partial(self._loop.request, 'home'))
        self.offer_job(topics.HALT, partial(self._loop.request, 'halt'))
        self.offer_job(topics.CLEAR_FAULTS, self._requests.clear_faults)
        offer_later(self, topics.SELF_TEST, self._requests.self_test)
        steady_timer(self, 1.0 / STATES_RATE, self._publish_joint_states)
        steady_timer(self, SUPERVISION_PERIOD, self._supervise)

        self.get_logger().info(f'version: {self._version}; profiles: {self._profiles}')
        if self._settings.configure_at_start:
            self.configure_soon(self._setup.bus.missing)

    def close(self) -> None:
        """Ramp down, power off, close the bus and end the process of the loop."""
        self._requests.close()

    def handle_exception(self, error: Exception) -> None:
        """Stop the drives, because a callback of this node has a defect."""
        self._loop.stop(f'a callback of the driver raised {error!r}')

    def next_step(self) -> str:
        """Return the next step of the operator, as the end of a message."""
        step = self._loop.snapshot().next_step
        return f'; next: {step}' if step else ''

    def report(self, is_successful: bool, message: str) -> None:
        """Report the result of a request in the log, on driver/status and on /diagnostics."""
        super().report(is_successful, message)
        self._publish_status()
        self._diagnostics.publish()

    def _declare_setup(self) -> LoopSetup:
        geometry = declare(self, Geometry, 'geometry')
        controller = declare(self, ControllerSettings, 'controller')
        axes = read_axes(partial(declare, self), geometry.stroke)
        bus = declare(self, BusSettings, 'bus')
        stream = declare(self, StreamSettings, 'stream')
        limits = declare(
            self, MotionLimits, 'limits', self._change_limits,
            lambda limits: StoppingAnalysis(geometry, limits, axes, controller).check())
        setup = LoopSetup(geometry, controller, axes, bus, stream, limits)
        if not self._settings.simulate_drives:
            return setup
        simulator = import_module('facade_manipulator.simulation.drives.simulator')
        return replace(setup, bus=replace(bus, interface='virtual'),
                       simulate=simulator.start_simulator)

    def _change_limits(self, limits: MotionLimits) -> None:
        self._loop.change(limits=limits)
        self.get_logger().info(
            f'limits of motion changed to {limits.speed:g} m/s, {limits.acceleration:g} m/s^2, '
            f'{limits.jerk:g} m/s^3')

    def _receive_setpoint(self, message: JointState) -> None:
        state = self._loop.snapshot().state
        if state is not ControllerState.ACTIVE:
            error = InputError(
                state.value, f'setpoint rejected: the drives are {state.value}, required is '
                f'active{self.next_step()}')
            # ik_service receives the new state a moment after an ordinary deactivate
            self.rejections.add(error, is_logged=state is not ControllerState.DEACTIVATING)
            return
        self._loop.send_setpoint(Setpoint(
            seconds(message.header.stamp),
            carriages_from(message.name, message.position, 'setpoint position'),
            carriages_from(message.name, message.velocity, 'setpoint velocity')))

    def _receive_forces(self, message: JointState) -> None:
        """Apply the forces of the simulated wall to the simulated drives."""
        self._loop.apply_forces(
            carriages_from(message.name, message.effort, 'carriage_forces effort'))

    def _receive_stop(self, name: str, message: Bool, _: object = None) -> None:
        """Receive a stop, also one that is rejected because its topic has two publishers."""
        self._software_stop.receive(name, message.data, time.monotonic())
        self._apply_software_stop()

    def _apply_software_stop(self) -> None:
        self._loop.forbid_power(self._software_stop.cause)

    def _publish_joint_states(self) -> None:
        for snapshot in self._loop.take_states():
            joints = snapshot.joints()
            if joints is not None and joints.stamp != self._published_stamp:
                self._published_stamp = joints.stamp
                self._joint_states.publish(joint_state(*joints))

    def _supervise(self) -> None:
        """Apply new states of the loop; feed it last, so that an exception before stops it."""
        snapshot = self._loop.snapshot()
        self._software_stop.watch(time.monotonic())
        self._apply_software_stop()
        self.jobs.finish_done()
        if snapshot.state in STOPPED_STATES and not self._was_stopped:
            self._drive_faults += 1
            self.get_logger().error(f'{snapshot.cause}; next: {snapshot.next_step}')
        self._was_stopped = snapshot.state in STOPPED_STATES
        self._publish_status()
        if not snapshot.state.is_active:
            self.fall_back(snapshot.state in (ControllerState.LOST, ControllerState.UNCONFIGURED))
        self._diagnostics.publish_change((snapshot.outcome(), self._outcome(snapshot)))
        self._loop.feed()

    def _publish_status(self) -> None:
        snapshot = self._loop.snapshot()
        self._status.update(
            ros_time(), snapshot, self._loop.stream_status(), self._outcome(snapshot))

    def _outcome(self, snapshot: ControllerSnapshot) -> tuple[str, str]:
        """Return level and message: why the drives stopped, or what the operator must correct."""
        fault = '; '.join(filter(None, [self._requests.rival, self._inputs.fault]))
        overload = driver_diagnostics.overload(snapshot)
        return driver_diagnostics.group_outcome(
            snapshot, '; '.join(filter(None, [self.last_failure, overload])), fault)

    def _components(self) -> list[DiagnosticStatus]:
        snapshot, controller = self._loop.snapshot(), self._setup.controller
        counters = {
            'drive faults': self._drive_faults,
            'targets ahead of their SYNC [ms]': 1e3 * (controller.period + controller.drive_lag),
            'version': self._version,
            'profiles': self._profiles,
        }
        return [
            driver_diagnostics.operation_status(
                snapshot, self._loop.stream_status(), self._outcome(snapshot), counters),
            driver_diagnostics.bus_status(snapshot, not self._settings.simulate_drives),
            *map(driver_diagnostics.axis_status, snapshot.axes),
        ]


main = partial(run, lambda: [DriverNode()])

if __name__ == '__main__':
    raise SystemExit(main())
