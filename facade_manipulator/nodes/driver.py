"""
Driver node: ROS interface of the control loop, which runs in a separate process.

The node is a managed node: configure starts the bus and checks the drives, activate powers the
drives on. A stop of the drives makes the node inactive. The end of the control loop makes it
unconfigured, and the next configure starts another loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.metadata import version
import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.srv import SelfTest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from facade_manipulator import topics
from facade_manipulator.control_loop.loop_client import (
    FEED_PERIOD,
    LoopClient,
    start_process,
)
from facade_manipulator.drives.controller_settings import STATES_RATE
from facade_manipulator.drives.outcome import DriverOutcome, NodeProblems, outcome_of
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import (
    DriveError,
    DriveStateError,
    InputError,
    joined,
    ManipulatorError,
)
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.nodes import driver_diagnostics
from facade_manipulator.nodes.conversions import joint_state, steady_timer, system_time
from facade_manipulator.nodes.diagnostics import diagnostic_status, Diagnostics
from facade_manipulator.nodes.driver_status import state_sentence, STATUS_PERIOD
from facade_manipulator.nodes.lifecycle import ManagedNode, OnReply, UNCONFIGURED_LABEL
from facade_manipulator.nodes.node_parameters import accept_changes, NodeParameters
from facade_manipulator.nodes.node_settings import DriverSetup
from facade_manipulator.nodes.node_subscriptions import PublisherWatch
from facade_manipulator.nodes.planar_messages import carriages_from, seconds
from facade_manipulator.nodes.run import run
from facade_manipulator.nodes.software_stop import SoftwareStop


class DriverNode(ManagedNode):
    """
    Driver node: ROS interface of the control loop.

    Parameters
    ----------
    launch : callable
        Starts the process of the loop; see `control_loop.loop_client.LoopClient`.

    """

    wants_priority = True

    def __init__(
        self, launch: Callable[..., Any] = start_process, **kwargs: Any
    ) -> None:
        super().__init__('driver', **kwargs)
        settings, setup = DriverSetup.read(NodeParameters(self))
        self._is_simulated = settings.simulate_drives
        self.diagnostics = Diagnostics(self, self._components)
        log_level = int(self.get_logger().get_effective_level())  # numbers of logging
        self._loop = LoopClient(
            replace(setup, log_level=log_level),
            lambda *error: self.diagnostics.reject(InputError(*error)),
            launch,
        )
        accept_changes(
            self, MotionLimits, 'limits', self._change_limits, self._loop.check
        )
        lead = setup.controller.period + setup.controller.drive_lag
        self._constants = {
            'targets ahead of their SYNC [ms]': 1e3 * lead,
            'version': version('facade_manipulator'),
        }
        self._published_stamp: float | None = None  # of joint_states
        self._published_outcome: DriverOutcome | None = None
        self._published_states: Any = None  # of bus and axes, on /diagnostics
        self._status_due = -math.inf  # s, monotonic
        self._active_since = math.inf  # s, monotonic
        self._stops = driver_diagnostics.StopCounter()

        self._joint_states = self.create_publisher(*topics.JOINT_STATES)
        self._message = JointState(name=AXIS_NAMES)  # of each joint state
        self._status = self.create_publisher(*topics.DRIVER_STATUS)
        self._inputs = PublisherWatch(self, self.diagnostics, self._apply_software_stop)
        # of another driver in the namespace
        self._inputs.watch(topics.DRIVER_STATUS)
        self._inputs.subscribe(topics.JOINT_SETPOINTS, self._receive_setpoint)
        if self._is_simulated:
            self._inputs.subscribe(topics.CARRIAGE_FORCES, self._receive_forces)
        self._software_stop = SoftwareStop(
            settings.software_stop_topics,
            settings.software_stop_timeout,
            self._inputs.fault_of,
        )
        for name in settings.software_stop_topics:
            receive = partial(self._receive_stop, name)
            self._inputs.subscribe(
                topics.SOFTWARE_STOP._replace(name=name), receive, receive
            )
        self.transitions = {
            'configure': partial(self._start_alone, 'configure'),
            'activate': partial(self._start_alone, 'activate'),
            'deactivate': partial(self._loop.request, 'deactivate'),
            'cleanup': partial(self._loop.request, 'cleanup'),
            'shutdown': self._loop.shut_down,
        }
        self.offer(topics.HOME, partial(self._loop.request, 'home'))
        self.offer(topics.HALT, partial(self._loop.request, 'halt'))
        self.offer(topics.CLEAR_FAULTS, self._clear_faults)
        self.offer(
            topics.SELF_TEST, partial(self._loop.request, 'self_test'), self._self_test
        )
        steady_timer(self, 1.0 / STATES_RATE, self._publish_joint_states)
        steady_timer(self, FEED_PERIOD, self._supervise)

        self.get_logger().info('version: {version}'.format(**self._constants))
        if settings.configure_at_start:
            self.configure_soon(setup.bus.missing)

    def close(self) -> None:
        """Ramp down, power off, close the bus and end the loop's process."""
        try:
            self.get_logger().info(self._loop.close())
        except DriveError as error:
            self.get_logger().error(str(error))
        if self.context.ok():  # other nodes need not wait for the silence
            self._publish_outcome()

    def handle_exception(self, error: Exception) -> None:
        """Stop the drives after an exception, a programming error, in a callback of this node."""
        self._loop.stop(f'a callback of the driver raised {error!r}')

    def next_step(self) -> str:
        """Return the operator's next step as the end of a message."""
        return self._outcome().with_next_step('')

    def report(self, is_successful: bool, message: str) -> None:
        """Report the result of a request in the log, in driver/status and in /diagnostics."""
        super().report(is_successful, message)
        self._publish_outcome()

    def _change_limits(self, limits: MotionLimits) -> None:
        self._loop.change(limits=limits)
        self.get_logger().info(
            f'limits of motion changed to {limits.speed:g} m/s, {limits.acceleration:g} m/s^2, '
            f'{limits.jerk:g} m/s^3'
        )

    def _receive_setpoint(self, message: JointState) -> None:
        """Send a setpoint to the control loop; raise an InputError if it is malformed."""
        state = self._loop.snapshot().state
        if state is not ControllerState.ACTIVE:
            reason = (
                f'setpoint rejected: {state_sentence(state.value)} and must be active'
            )
            error = InputError(state.value, self._outcome().with_next_step(reason))
            # ik_service receives the new state a moment after an ordinary deactivate
            self.diagnostics.reject(
                error, is_logged=state is not ControllerState.DEACTIVATING
            )
            return
        self._loop.send_setpoint(
            Setpoint(
                seconds(message.header.stamp),
                carriages_from(message.name, message.position, 'setpoint position'),
                carriages_from(message.name, message.velocity, 'setpoint velocity'),
            )
        )

    def _receive_forces(self, message: JointState) -> None:
        """Apply the contact forces of the simulated wall to the simulated drives."""
        self._loop.apply_forces(
            carriages_from(message.name, message.effort, 'carriage_forces effort')
        )

    def _receive_stop(self, name: str, message: Bool, _: object = None) -> None:
        """Record a software stop, also if the topic has two publishers."""
        self._software_stop.receive(name, message.data, time.monotonic())
        self._apply_software_stop()

    def _apply_software_stop(self) -> None:
        now = time.monotonic()
        cause = self._software_stop.cause(now)
        self._loop.forbid_power(
            cause, self._software_stop.next_step(now), self._software_stop.is_latched
        )

    def _publish_joint_states(self) -> None:
        """Publish the positions measured at each new SYNC, once."""
        for snapshot in self._loop.take_states():
            joints = snapshot.joints()
            if joints is not None and joints.stamp != self._published_stamp:
                self._published_stamp = joints.stamp
                self._joint_states.publish(joint_state(*joints, message=self._message))

    def _supervise(self) -> None:
        """Apply new states of the loop, then feed the loop, which ends if it is not fed."""
        snapshot = self._loop.snapshot()
        self._apply_software_stop()
        if stop := self._stops.count(snapshot):
            self.get_logger().error(stop)
        self._publish_outcome()
        # a silent loop may still answer, and is otherwise lost
        if not (snapshot.state.is_active or snapshot.state is ControllerState.SILENT):
            self.fall_back(
                snapshot.state in (ControllerState.LOST, ControllerState.UNCONFIGURED)
            )
        self._loop.feed()

    def _publish_outcome(self) -> None:
        """Publish a changed outcome; also publish driver/status every `STATUS_PERIOD`."""
        snapshot = self._loop.snapshot()
        now = time.monotonic()
        if snapshot.state is not ControllerState.ACTIVE:
            self._active_since = math.inf
        elif math.isinf(self._active_since):
            self._active_since = now

        outcome = self._outcome()
        has_changed = outcome != self._published_outcome
        if has_changed or now >= self._status_due:
            self._published_outcome = outcome
            self._status_due = now + STATUS_PERIOD
            self._status.publish(self._operation(outcome))
        states = snapshot.component_states()
        if has_changed or states != self._published_states:
            self._published_states = states
            self.diagnostics.publish()

    def _outcome(self) -> DriverOutcome:
        """Return the driver's outcome, including problems that only this node detects."""
        problems = NodeProblems(
            self.last_failure,
            self._inputs.fault,
            self._software_stop.cause(time.monotonic()),
        )
        activity = self._loop.stream_status().activity
        return outcome_of(self._loop.snapshot(), activity, problems)

    def _operation(self, outcome: DriverOutcome) -> DiagnosticStatus:
        return driver_diagnostics.operation_status(
            outcome,
            self._loop.snapshot(),
            self._loop.stream_status(),
            system_time(self._active_since),
            self._stops.values | self._constants,
            self._software_stop.notes,
        )

    def _components(self) -> list[DiagnosticStatus]:
        snapshot = self._loop.snapshot()
        return [
            self._operation(self._outcome()),
            driver_diagnostics.bus_status(snapshot, not self._is_simulated),
            *map(driver_diagnostics.axis_status, snapshot.axes),
        ]

    # --- requests

    def _start_alone(self, name: str, on_reply: OnReply) -> None:
        """
        Start a request, unless another driver would also follow the setpoints.

        If the control loop has ended, configure starts a new loop.
        """
        self._inputs.look()
        if fault := self._inputs.fault_of(topics.DRIVER_STATUS.name):
            raise DriveStateError(
                f'{name} rejected: {fault}, and both drivers would follow the setpoints; next: '
                f'end one of both drivers, or wait 20 s if a driver has crashed, then {name}'
            )
        if name == 'configure' and self._loop.snapshot().state is ControllerState.LOST:
            self._loop.start()
        self._loop.request(name, on_reply)

    def _clear_faults(self, on_reply: OnReply) -> None:
        """Release the software stops, then clear the drives' faults."""
        released = self._software_stop.clear(time.monotonic())
        self._apply_software_stop()
        cleared = ''.join(f'{name} is cleared; ' for name in sorted(released))
        if cleared and self.state_label == UNCONFIGURED_LABEL:
            on_reply(f'{cleared}next: configure, home, activate')
            return  # no drive has a fault to clear

        def finish(reply: Any) -> None:
            if isinstance(reply, ManipulatorError):
                self._software_stop.restore(released)
                self._apply_software_stop()
                on_reply(reply)
            else:
                on_reply(cleared + reply)

        self._loop.request('clear_faults', finish)

    def _self_test(self, reply: Any) -> SelfTest.Response:
        """Return the result for each drive and the component of bus and cycle."""
        problems = reply
        if isinstance(reply, ManipulatorError):
            # the name precedes each problem in the report
            problems = {'self_test': str(reply).removeprefix('self_test is ')}
        statuses = [
            diagnostic_status(
                name,
                'error' if problem else 'ok',
                problem or ('identity, units and objects are as configured'),
                {},
            )
            for name, problem in problems.items()
        ]
        statuses.append(
            driver_diagnostics.bus_status(self._loop.snapshot(), not self._is_simulated)
        )
        failures = []
        for one in statuses:
            if one.level != DiagnosticStatus.OK:
                failures.append(f'{one.name}: {one.message}')
        self.report(not failures, joined(*failures) or 'self_test passed')
        return SelfTest.Response(
            id=self.get_fully_qualified_name(),
            passed=bytes([not failures]),
            status=statuses,
        )


main = partial(run, lambda: [DriverNode()])

if __name__ == '__main__':
    raise SystemExit(main())
