"""A panel without ROS: what is seen of machines is made up, the server is the real one."""

import asyncio
from contextlib import contextmanager
import math
import threading
import time
from types import SimpleNamespace

from aiohttp import web

from facade_manipulator.interfaces import CORRECTED_POSE, END_EFFECTOR_POSE, GOAL_STATUS
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.nodes.overview import Seen
from facade_manipulator.tools.panel.server import Access, Server
from facade_manipulator.tools.panel.view import PERIOD, recordings, SPAN, View

CAUSE = ('q2 (node 2): following error 8611h, the carriage is 21.3 mm behind its setpoint, bound '
         '20 mm')
NEXT = 'free the carriage, then driver/clear_faults and ros2 lifecycle set /driver activate'
HEALTHY = {
    'driver: operation': ('ok', 'active', {'state': 'active', 'drive faults': '0'}),
    'driver: bus': ('ok', 'open', {'cycles': '1864', 'missed cycles': '0'}),
    **{f'driver: q{n}': ('ok', 'operation enabled', {}) for n in (1, 2, 3)},
    'driver: counters': ('ok', 'no service is due', {}),
    'compensator: correction': ('ok', 'compensating', {
        'rejected': '0', 'saturation error': 'x +0.0 mm, y +0.0 mm, theta +0.00 deg'}),
    'ik_service: goal': ('ok', 'following the goals', {'setpoints': '1700', 'rejected': '0'}),
    'recorder: black box': ('ok', 'nothing recorded yet', {'files written': '0'})}
STOPPED = {**HEALTHY, 'driver: operation': (
    'error', CAUSE, {'state': 'stopped', 'cause': CAUSE, 'next step': NEXT})}
LEVELS = 'ok', 'warn', 'error', 'stale'


def status(level, message, values):
    return SimpleNamespace(level=LEVELS.index(level), message=message, values=[
        SimpleNamespace(key=key, value=value) for key, value in values.items()])


class Machine:
    """What is seen of a gondola, at moments that the test chooses."""

    def __init__(self, name='gondola_1', past=SPAN):
        self.known = {}
        self.seen = Seen(name, {name: self.known})
        self.view = View(self.seen, Geometry(), 0.3)
        begin = time.monotonic() - past
        for k in range(round(past / PERIOD)):
            self.speak(begin + PERIOD * k)
            self.view.look(begin + PERIOD * k)

    def speak(self, now, statuses=HEALTHY):
        """Say how the components are, and where the head is."""
        for name, one in statuses.items():
            self.known[name] = SimpleNamespace(received=now, status=status(*one))
        sway, lag = 0.05 * math.sin(now), 0.0006 * math.sin(2.3 * now)
        self.seen.poses |= {
            END_EFFECTOR_POSE: (now, Pose(0.1 + sway + lag, 0.25, 0.03)),
            CORRECTED_POSE: (now, Pose(0.1 + sway, 0.25, 0.03)),
            GOAL_STATUS: (math.inf, Pose(0.1, 0.26, 0.0))}
        self.seen.joints = now, SimpleNamespace(
            name=['q1', 'q2', 'q3'], position=[-0.1, 0.3, 0.1], velocity=[0.01, 0.02, 0.0],
            effort=[12 * math.sin(now), -8 * math.sin(1.1 * now), 4.0])


class Bench:
    """A server on a port of its own, in a thread with a loop; `panel` says what it shows."""

    def __init__(self, access, folder):
        self.machines = {'gondola_1': (Machine(), HEALTHY)}
        self.doctor = [('versions', ''), ('clock', 'it is not synchronised; next: start chrony')]
        self.pause, self._access, self._folder = 0.1, access, folder
        self._loop, self._ready = asyncio.new_event_loop(), threading.Event()
        self._thread = threading.Thread(target=self._loop.run_until_complete,
                                        args=(self._run(),), name='panel')
        self._thread.start()
        self._ready.wait(10.0)

    @property
    def url(self):
        return f'http://127.0.0.1:{self.port}/'

    async def _run(self):
        self._over = asyncio.Event()
        self.server = Server(self._access, lambda: recordings(self._folder), lambda: {
            name: machine.view.past for name, (machine, _) in self.machines.items()})
        runner = web.AppRunner(self.server.application(), shutdown_timeout=0.2)
        await runner.setup()
        await web.TCPSite(runner, '127.0.0.1', 0).start()
        self.port = runner.addresses[0][1]
        self._ready.set()
        while not self._over.is_set():
            if self.pause:
                self.look()
            await asyncio.sleep(self.pause or 0.05)
        await runner.cleanup()

    def look(self):
        now, shown = time.monotonic(), []
        for machine, statuses in [*self.machines.values()]:
            if statuses:
                machine.speak(now, statuses)
            shown.append(machine.view.look(now))
        self.server.show({'gondolas': shown, 'more': 0, 'doctor': self.doctor, 'files': [
            (name, path.stat().st_size) for name, path in recordings(self._folder).items()]})

    def say(self, statuses, name='gondola_1'):
        """Let a gondola say something else from now on, or nothing."""
        machine = self.machines[name][0] if name in self.machines else Machine(name)
        self.machines[name] = machine, statuses

    def close(self):
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(10.0)
        self._loop.close()


@contextmanager
def panel_bench(folder, access=None):
    bench = Bench(access or Access('127.0.0.1'), folder)
    try:
        yield bench
    finally:
        bench.close()
