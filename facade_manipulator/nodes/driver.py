"""
The driver node: the ROS side of the control loop, which runs in a process of its own.

A managed node: configure brings the bus up and checks the drives, activate powers them on. It
never does so by itself, and whatever stops the drives makes it inactive again, with the reason in
/diagnostics and the next step in the reply of the service that is asked. If the loop's process
ends, the node becomes unconfigured; the next configure starts another one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from functools import partial
from importlib import import_module
import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.srv import SelfTest
from lifecycle_msgs.msg import State
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from facade_manipulator import interfaces
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.control_loop import LoopSetup, Simulator
from facade_manipulator.control_loop.process import LoopClient, start_process
from facade_manipulator.control_loop.stopping_analysis import StoppingAnalysis
from facade_manipulator.drives.axis_settings import axis_defaults, AxisSettings
from facade_manipulator.drives.commissioning import Finding
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.profile import profile_checksums
from facade_manipulator.drives.snapshot import ControllerSnapshot
from facade_manipulator.errors import DriveError, DriveStateError, InputError, ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.messages import carriages_from
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.nodes import driver_diagnostics
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.nodes.settings import DriverSettings
from facade_manipulator.resources import version
from facade_manipulator.ros.clocks import steady_timers
from facade_manipulator.ros.codec import setpoint_codec, states_codec
from facade_manipulator.ros.conversions import frames, node_time
from facade_manipulator.ros.diagnostics import DiagnosticsPublisher, Rejections
from facade_manipulator.ros.interfaces import publisher, service
from facade_manipulator.ros.lifecycle import Deferred, ManagedNode, may_defer
from facade_manipulator.ros.publisher_watch import PublisherWatch
from facade_manipulator.ros.runtime import run
from facade_manipulator.ros.software_stop import SoftwareStop, subscribe_software_stops

UNCONFIGURED = 'unconfigured'  # label of the lifecycle state
SUPERVISION_PERIOD = 0.02  # s: a fiftieth of a second is the node's whole delay


class DriverNode(ManagedNode):
    """
    ROS side of the control loop: parameters, messages, requests and their answers.

    Parameters
    ----------
    launch : callable
        Starts the loop's process; see `facade_manipulator.control_loop.LoopClient`.

    """

    def __init__(self, launch: Callable[..., Any] = start_process, **kwargs: Any) -> None:
        super().__init__('driver', **kwargs)
        self._rejections = Rejections(self)
        self._settings = declare(self, DriverSettings)
        self._setup = self._declare_setup()
        self._limits, self._limits_changed = self._setup.limits, ''
        self._profiles = self._read_profiles()
        self._loop = LoopClient(
            self._setup, lambda *error: self._rejections.add(InputError(*error)), launch)
        self._worker = ThreadPoolExecutor(max_workers=1)
        self._published_stamp: float | None = None
        self._drive_faults = 0
        self._was_stopped = False
        self._last_failure = ''
        self._status = driver_diagnostics.StatusPublisher(
            publisher(self, interfaces.DRIVER_STATUS).publish, partial(node_time, self))
        self._setpoint_codec, self._states_codec = (
            setpoint_codec(frames(self).rail), states_codec())
        self._offer()
        self.get_logger().info(
            f'version: {version()}; profiles: {self._profiles}')
        if self._settings.configure_at_start:
            self.configure_soon(self._setup.bus.missing)

    def transition_jobs(self) -> Any:
        """Return what starts each lifecycle transition."""
        return {
            State.TRANSITION_STATE_CONFIGURING: lambda: self._start_alone(
                'configure', self._configure),
            State.TRANSITION_STATE_ACTIVATING: lambda: self._start_alone(
                'activate', lambda: self._loop.request('activate')),
            State.TRANSITION_STATE_DEACTIVATING: lambda: self._loop.request('deactivate'),
            State.TRANSITION_STATE_CLEANINGUP: lambda: self._loop.request('cleanup'),
            State.TRANSITION_STATE_SHUTTINGDOWN: self._shut_down,
        }

    def following_step(self) -> str:
        """Return the next step of the drives."""
        step = self._loop.snapshot().next_step
        return f'; next: {step}' if step else ''

    def report(self, success: bool, message: str) -> None:
        """Say how a request ended, in the log and in /diagnostics."""
        super().report(success, message)
        self._last_failure = '' if success else message
        self._publish_status()
        self._diagnostics.publish()

    def _publish_status(self) -> None:
        self._status.publish(
            self._loop.snapshot(), self._loop.stream_status().activity, self._warning(),
            self._sources.fault)

    def _fault(self) -> str:
        """Return which other nodes command the drives too, ``''`` for none."""
        return '; '.join(filter(None, [self._rival(), self._sources.fault]))

    def _warning(self) -> str:
        """Return what is wrong though the drives go on: rejected last, or a slow computer."""
        late = driver_diagnostics.overload(self._loop.snapshot())
        return '; '.join(filter(None, [self._last_failure, late]))

    def close(self) -> None:
        """Ramp down, power off, leave the bus; ends the loop's process."""
        try:
            self.get_logger().info(self._loop.close())
        except DriveError as error:
            self.get_logger().error(str(error))
        self._worker.shutdown()

    def _declare_setup(self) -> LoopSetup:
        geometry = declare(self, Geometry, 'geometry')
        controller = declare(self, ControllerSettings, 'controller')
        axes = tuple(declare(self, AxisSettings, name, **defaults)
                     for name, defaults in axis_defaults(geometry.stroke).items())
        bus = declare(self, BusSettings, 'bus')
        if self._settings.simulate_drives:
            bus = replace(bus, interface='virtual')
        return LoopSetup(
            geometry, controller, axes, bus,
            declare(self, StreamSettings, 'stream'),
            declare(
                self, MotionLimits, 'limits', self._change_limits,
                lambda limits: StoppingAnalysis(geometry, limits, axes, controller).check()),
            _simulator() if self._settings.simulate_drives else None)

    def _offer(self) -> None:
        self._joint_states = publisher(self, interfaces.JOINT_STATES)
        self._sources = PublisherWatch(self, self._rejections, self._apply_software_stop)
        self._sources.subscribe(
            interfaces.JOINT_SETPOINTS, self._receive_setpoint, raw=True)
        if self._settings.simulate_drives:
            self._sources.subscribe(interfaces.CARRIAGE_FORCES, self._receive_forces)
        self._software_stop = SoftwareStop(self._settings.software_stop_topics)
        subscribe_software_stops(
            self, self._software_stop, self._sources, self._apply_software_stop)
        self._offer_request(interfaces.HOME, partial(self._loop.request, 'home'))
        self._offer_request(interfaces.HALT, partial(self._loop.request, 'halt'))
        self._offer_request(interfaces.CLEAR_FAULTS, self._clear_faults)
        may_defer(self, service(self, interfaces.SELF_TEST, lambda *_: Deferred(
            self._loop.request('self_test'), self._self_test_response)))
        self._diagnostics = DiagnosticsPublisher(self, self._components)
        rate = self._settings.joint_states_rate
        every = math.ceil(self._setup.controller.rate / rate)
        steady_timers(
            self, min(1.0 / rate, SUPERVISION_PERIOD), lambda: self._publish_joint_states(every),
            SUPERVISION_PERIOD, self._supervise)

    def _offer_request(
        self, request: interfaces.Service, start: Callable[[], Future[Any]]
    ) -> None:
        def answer(job: Future[Any]) -> Trigger.Response:
            error = job.exception()
            message = str(error or job.result())
            self.report(error is None, message)
            return Trigger.Response(success=error is None, message=message)

        may_defer(self, service(
            self, request, lambda *_: Deferred(start(), answer)))

    def _apply_software_stop(self) -> None:
        stop = self._software_stop
        for name in stop.topics:
            stop.note_publishers(name, self._sources.fault_of(name))
        self._loop.forbid_power(stop.cause)

    def _clear_faults(self) -> Future[Any]:
        """Release the software stops, then let the drives clear theirs."""
        stop, job = self._software_stop, Future[Any]()
        try:
            released = stop.clear(time.monotonic(), self._settings.software_stop_timeout)
        except DriveStateError as error:
            job.set_exception(error)
            return job
        self._apply_software_stop()
        cleared = ''.join(f'{name} is cleared; ' for name in sorted(released))
        if cleared and self.state_label == UNCONFIGURED:  # no drive has a fault to clear
            job.set_result(f'{cleared}next: configure, home, activate')
            return job

        def finish(done: Future[Any]) -> None:
            error = done.exception()
            if error is None:
                job.set_result(cleared + done.result())
                return
            stop.restore(released)
            self._apply_software_stop()
            job.set_exception(error)

        self._loop.request('clear_faults').add_done_callback(finish)
        return job

    def _self_test_response(self, job: Future[Any]) -> SelfTest.Response:
        error = job.exception()
        findings = [Finding('self_test', False, str(error))] if error else job.result()
        passed, message = driver_diagnostics.self_test_outcome(findings)
        self.report(passed, message)
        return SelfTest.Response(
            id=self.get_fully_qualified_name(), passed=bytes([passed]),
            status=[driver_diagnostics.finding_status(finding) for finding in findings])

    def _receive_forces(self, message: JointState) -> None:
        """Let the simulated drives feel what the simulated wall does."""
        with self._rejections:
            self._loop.apply_forces(
                carriages_from(message.name, message.effort, 'carriage_forces effort'))

    def _change_limits(self, limits: MotionLimits) -> None:
        before, self._limits = self._limits, limits
        self._loop.change(limits=limits)
        self._limits_changed = (
            f'{datetime.now().astimezone().isoformat(timespec="seconds")}: '
            f'from {_in_words(before)} to {_in_words(limits)}')
        self.get_logger().info(f'limits of motion changed, {self._limits_changed}')

    def _start_alone(self, name: str, start: Callable[[], Future[Any]]) -> Future[Any]:
        """Start a request unless another driver would follow the setpoints as well."""
        rival = self._rival()
        if not rival:
            return start()
        job: Future[Any] = Future()
        job.set_exception(DriveStateError(f'{name} is not possible, {rival}, then {name}'))
        return job

    def _rival(self) -> str:
        """Return what is wrong and the next step where another driver runs beside this one."""
        topic = self.resolve_topic_name(interfaces.DRIVER_STATUS.name)
        if self.count_publishers(topic) < 2:
            return ''
        return (f'another driver runs in namespace {self.get_namespace()}, and both would follow '
                'the setpoints; next: end one of the two')

    def _configure(self) -> Future[Any]:
        """Configure; if the loop's process has ended, start another one before."""
        self._profiles = self._read_profiles()
        if not self._loop.is_lost:
            return self._loop.request('configure')

        def begin_again() -> str:
            self._loop.start()
            return self._loop.request('configure').result()

        return self._worker.submit(begin_again)

    def _read_profiles(self) -> str:
        return profile_checksums(axis.profile for axis in self._setup.axes)

    def _shut_down(self) -> Future[Any]:
        return self._worker.submit(self._loop.close)

    def _receive_setpoint(self, data: bytes) -> None:
        try:
            self._require_active()
            time, (q1, q2, q3, v1, v2, v3) = self._setpoint_codec.read(data)
            self._loop.send_setpoint(Setpoint(time, (q1, q2, q3), (v1, v2, v3)))
        except ManipulatorError as error:  # who sends them learns by and by that it deactivates
            state = self._loop.snapshot().state
            self._rejections.add(error, is_logged=state is not ControllerState.DEACTIVATING)

    def _require_active(self) -> None:
        state = self._loop.snapshot().state
        if state is not ControllerState.ACTIVE:
            raise InputError(
                state.value, f'setpoint rejected: the drives are {state.value}, not active'
                f'{self.following_step()}')

    def _supervise(self) -> None:
        self._loop.feed()
        snapshot, now = self._loop.snapshot(), time.monotonic()
        self._software_stop.watch(now, self._settings.software_stop_timeout)
        self._apply_software_stop()
        self._log_stop(snapshot)
        self._publish_status()
        if not snapshot.state.is_active:
            self.fall_back(snapshot.state in (ControllerState.LOST, ControllerState.UNCONFIGURED))
        self._diagnostics.publish_news(
            (snapshot.outcome(), self._warning(), self._sources.fault))

    def _log_stop(self, snapshot: ControllerSnapshot) -> None:
        is_stopped = snapshot.state in (ControllerState.STOPPED, ControllerState.LOST)
        if is_stopped and not self._was_stopped:
            self._drive_faults += 1
            self.get_logger().error(f'{snapshot.cause}; next: {snapshot.next_step}')
        self._was_stopped = is_stopped

    def _publish_joint_states(self, every: int) -> None:
        for snapshot in self._loop.take_states(every):
            joints = snapshot.joints()
            if joints is not None and joints.stamp != self._published_stamp:
                self._published_stamp = joints.stamp
                self._joint_states.publish(self._states_codec.write(
                    joints.stamp, joints.positions + joints.velocities + joints.forces))

    def _components(self) -> list[DiagnosticStatus]:
        snapshot, settings = self._loop.snapshot(), self._setup.controller
        values = {
            'drive faults': self._drive_faults,
            'targets ahead of their SYNC [ms]': 1e3 * (settings.period + settings.drive_lag),
            'version': version(),
            'profiles': self._profiles,
            'limits changed': self._limits_changed,
            **self._rejections.values(),
        }
        return [
            driver_diagnostics.operation_status(
                snapshot, self._loop.stream_status(), self._warning(), values, self._fault()),
            driver_diagnostics.bus_status(snapshot, not self._settings.simulate_drives),
            *(driver_diagnostics.axis_status(axis) for axis in snapshot.axes),
        ]


def _simulator() -> Callable[[BusSettings, Sequence[AxisSettings]], Simulator]:
    """Return what starts simulated drives: known by name alone, for no machine needs them."""
    return import_module('facade_manipulator.simulation.drives.simulator').start_simulator


def _in_words(limits: MotionLimits) -> str:
    return f'{limits.speed:g} m/s, {limits.acceleration:g} m/s^2, {limits.jerk:g} m/s^3'


main = partial(run, lambda: [DriverNode()])

if __name__ == '__main__':
    raise SystemExit(main())
