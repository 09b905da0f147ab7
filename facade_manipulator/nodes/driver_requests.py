"""Requests of the driver: lifecycle transitions, clear_faults and the self-test."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
import time
from typing import Any

from diagnostic_msgs.srv import SelfTest

from facade_manipulator import topics
from facade_manipulator.control_loop.process import LoopClient
from facade_manipulator.drives.drive_access import Finding
from facade_manipulator.errors import DriveError, DriveStateError
from facade_manipulator.nodes.diagnostics import diagnostic_status
from facade_manipulator.nodes.lifecycle import ManagedNode, UNCONFIGURED
from facade_manipulator.nodes.software_stop import SoftwareStop

Job = Future[Any]


class DriverRequests:
    """
    Start the requests of the driver node as jobs of the control loop.

    Parameters
    ----------
    node : ManagedNode
    loop : LoopClient
    stop : SoftwareStop
    apply_stop : callable
        Forbids or allows power after `stop` has changed.

    """

    def __init__(
        self, node: ManagedNode, loop: LoopClient, stop: SoftwareStop,
        apply_stop: Callable[[], None],
    ) -> None:
        self._node, self._loop, self._stop, self._apply_stop = node, loop, stop, apply_stop
        self._worker = ThreadPoolExecutor(max_workers=1)  # for calls of the loop that wait
        self.transitions: dict[str, Callable[[], Job]] = {
            'configure': self._configure,
            'activate': partial(self._start_sole, 'activate'),
            'deactivate': partial(loop.request, 'deactivate'),
            'cleanup': partial(loop.request, 'cleanup'),
            'shutdown': partial(self._worker.submit, loop.close)}

    def close(self) -> None:
        """Ramp down, power off, close the bus and end the process of the loop."""
        try:
            self._node.get_logger().info(self._loop.close())
        except DriveError as error:
            self._node.get_logger().error(str(error))
        self._worker.shutdown()

    @property
    def rival(self) -> str:
        """Return the fault and the next step where another driver runs in the namespace."""
        node = self._node
        if node.count_publishers(node.resolve_topic_name(topics.DRIVER_STATUS.name)) < 2:
            return ''
        return (f'another driver runs in namespace {node.get_namespace()}, and both would follow '
                'the setpoints; next: end one of the two')

    def _start_sole(self, name: str) -> Job:
        """Start a request unless another driver would follow the setpoints as well."""
        if rival := self.rival:
            raise DriveStateError(f'{name} is not possible, {rival}, then {name}')
        return self._loop.request(name)

    def _configure(self) -> Job:
        """Configure; start another control loop before where the previous one has ended."""
        if self.rival or not self._loop.is_lost:
            return self._start_sole('configure')

        def restart() -> str:
            self._loop.start()
            return self._loop.request('configure').result()

        return self._worker.submit(restart)

    def clear_faults(self) -> Job:
        """Release the software stops, then let the drives clear their faults."""
        released, job = self._stop.clear(time.monotonic()), Job()
        self._apply_stop()
        cleared = ''.join(f'{name} is cleared; ' for name in sorted(released))
        if cleared and self._node.state_label == UNCONFIGURED:  # no drive has a fault to clear
            job.set_result(f'{cleared}next: configure, home, activate')
            return job

        def finish(done: Job) -> None:
            if error := done.exception():
                self._stop.restore(released)
                self._apply_stop()
                job.set_exception(error)
            else:
                job.set_result(cleared + done.result())

        self._loop.request('clear_faults').add_done_callback(finish)
        return job

    def self_test(
        self, _: SelfTest.Request, respond: Callable[[SelfTest.Response], None]
    ) -> None:
        """Test identity, objects, bus load and latency of the drives."""
        def finish(job: Job) -> None:
            error = job.exception()
            findings = [Finding('self_test', False, str(error))] if error else job.result()
            failed = [f'{one.name}: {one.message}' for one in findings if not one.passed]
            self._node.report(not failed, '; '.join(failed) or 'self-test passed')
            respond(SelfTest.Response(
                id=self._node.get_fully_qualified_name(), passed=bytes([not failed]),
                status=[diagnostic_status(name, 'ok' if passed else 'error', message, {})
                        for name, passed, message in findings]))

        self._node.jobs.add(partial(self._loop.request, 'self_test'), finish)
