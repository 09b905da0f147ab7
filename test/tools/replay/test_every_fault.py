"""The fault table, recorded from the bus, stops the drives once more for the same causes."""

from __future__ import annotations

from contextlib import contextmanager
from types import SimpleNamespace

from can.interfaces.virtual import VirtualBus
from fault_table import ROWS
import pytest
from virtual_world import World

from facade_manipulator.blackbox import Received, RecordedRun
from facade_manipulator.drives.canopen import ERROR_FRAME
from facade_manipulator.drives.controller import ControllerState
from facade_manipulator.motion import Setpoint
from facade_manipulator.tools.replay import StopReplay
from facade_manipulator.tools.replay.stop import drive_faults, recorded_stop

NODE_IDS = {f'q{number}.node_id': number for number in (1, 2, 3)}
STOPPED = (ControllerState.STOPPED, ControllerState.BUS_LOST)
MOVING, SPEED, LEAD, BOUND = 0.2, 0.02, 0.04, 0.7  # s, m/s, s, s
# the other errors of drives differ by their codes alone
REPLAYED = ('following error 8611', 'position lost 7380', 'undervoltage 3220',
            'safe torque off 8A88', 'unknown code B123', 'TPDO missing', 'heartbeat missing',
            'unexpected boot-up')
FAULTS = {name: (ROWS[name].message, ROWS[name].inject) for name in REPLAYED} | {
    'link down': ('interface is down', lambda rig: setattr(rig.world, 'bus_is_down', True)),
    'bus off': ('bus-off', lambda rig: rig.world.drives[0].send_message(
        ERROR_FRAME | 0x040, bytes(8)))}


class Recorded:
    """A machine that moves until its drives stop, and who listens on the bus."""

    def __init__(self, faults) -> None:
        """Let each of `faults`, pairs of a time since motion began [s] and a function, happen."""
        self.world = world = World()
        try:
            for request in ('configure', 'home', 'activate'):
                world.finish(world.controller.request(request), 60.0)
            self.base, self.begin = world.follower.motion.position, world.time.now
            self.faults = sorted(faults, key=lambda fault: fault[0])
            with VirtualBus(world.channel) as bus:
                world.run(MOVING + BOUND, self._live)
                self.frames = list(iter(lambda: bus.recv(0.0), None))
            self.start = world.time.time() - world.time.now + self.begin
            self.state, self.cause = (world.controller.snapshot().state.value,
                                      world.controller.snapshot().cause)
        finally:
            world.close()

    def _live(self) -> None:
        world, since = self.world, self.world.time.now - self.begin
        while self.faults and self.faults[0][0] <= since:
            self.faults.pop(0)[1](self)
        if world.controller.snapshot().state not in STOPPED:
            world.stream(Setpoint(
                world.time.time() + LEAD, tuple(q + SPEED * (since + LEAD) for q in self.base),
                (SPEED,) * 3))

    @property
    def simulator(self):
        """What an injection of the fault table wants of its rig."""
        @contextmanager
        def access():
            yield self.world.drives
        return SimpleNamespace(access=access)

    def run(self) -> RecordedRun:
        """Return what the black box would have in its file."""
        made = RecordedRun(begin=self.start, end=self.start + MOVING + BOUND,
                           parameters={'driver': NODE_IDS})
        made.topics['/diagnostics'] = [
            Received(self.start + MOVING * number, SimpleNamespace(status=[SimpleNamespace(
                name='driver: operation', message='', level=b'\0', values=[
                    SimpleNamespace(key='state', value=state),
                    SimpleNamespace(key='cause', value=self.cause)])]))
            for number, state in enumerate(('active', self.state))]
        made.topics['can_frames'] = [
            Received(frame.timestamp, SimpleNamespace(
                id=frame.arbitration_id, is_error=frame.is_error_frame, dlc=frame.dlc,
                data=bytes(frame.data)))
            for frame in self.frames if frame.timestamp >= self.start]
        return made


def as_replayed(fault):
    return lambda rig: getattr(rig.world.drives[fault.axis], fault.method)(*fault.arguments)


@pytest.mark.long
@pytest.mark.parametrize('name', FAULTS)
def test_a_fault_of_a_drive_is_found_on_the_bus_and_stops_it_again_for_the_same_cause(name):
    cause, inject = FAULTS[name]
    recorded = Recorded([(MOVING, inject)])
    assert cause in recorded.cause
    faults = drive_faults(recorded.run())
    replayed = Recorded([(fault.time - recorded.start, as_replayed(fault)) for fault in faults])
    stops = [recorded_stop(one.run()) for one in (recorded, replayed)]
    assert stops[0].cause == recorded.cause
    assert StopReplay(*stops, faults, []).is_alike, (stops, faults)
