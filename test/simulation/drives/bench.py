"""Bench for one simulated drive: a minimal master that sends bytes, and a simulated clock."""

from __future__ import annotations

from collections import namedtuple
import struct

from frames import decode_tpdo1, decode_tpdo2, encode_rpdo1

from facade_manipulator.canopen.sdo import expedited_download
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.configuration import drive_writes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import Controlword, decode_state, Mode, State
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.motor import SimulationSettings

NODE = 2
Emergency = namedtuple('Emergency', 'code register vendor_data')
PERIOD = 0.01
NMT_START = 1
NMT_RESET = 129
NMT_RESET_COMMUNICATION = 130
CPM = AxisSettings().counts_per_metre
WAY_UP = {
    State.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
    State.READY_TO_SWITCH_ON: Controlword.SWITCH_ON,
    State.SWITCHED_ON: Controlword.ENABLE_OPERATION,
}
AXIS = AxisSettings(
    node_id=NODE,
    profile='simulated',
    lower_limit=-0.5,
    upper_limit=0.5,
    limit_margin=0.0,
    max_speed=0.6,
    max_acceleration=6.0,
    stop_deceleration=5.0,
    following_error_window=0.02,
    homing_speed=0.1,
    homing_acceleration=1.0,
)


class Bench:
    """Simulated drive, its time, and every frame that it sent."""

    def __init__(self, profile='simulated', start=0.0, **settings):
        self.profile = load_profile(profile) if isinstance(profile, str) else profile
        axis = AxisSettings(
            node_id=NODE, home_position=start, lower_limit=-0.56, upper_limit=0.56
        )
        simulation = SimulationSettings(**settings)
        self.drive = SimulatedDrive(axis, simulation, self.profile)
        self.drive.set_identity(1, 2, 3, 4)
        self.now = 0.0
        self.sent = []
        self.controlword = 0
        self.target = 0
        self.mode = Mode.CYCLIC_SYNCHRONOUS_POSITION
        self.sends_heartbeat = False
        self.status = None
        self.motion = None

    # --- frames

    def send(self, cob_id, data=b''):
        answer = self.drive.receive(cob_id, bytes(data), self.now)
        self.sent += answer
        return answer

    def wait(self, seconds):
        """Call the drive at each of its deadlines; return the frames that it sends."""
        end = self.now + seconds
        answer = []
        while self.now < end:
            self.now = min(max(self.drive.deadline, self.now), end)
            answer += self.drive.advance(self.now)
        self.sent += answer
        return answer

    def nmt(self, command):
        return self.send(0, [command, NODE])

    def sdo(self, data):
        ((_, answer),) = self.send(0x600 + NODE, data)
        return answer

    def write(self, index, subindex, value, size=None):
        """Write an object; return None, or the abort code."""
        size = size or len(self.drive.objects.variables[index, subindex]) // 8
        data = (value & (1 << 8 * size) - 1).to_bytes(size, 'little')
        answer = self.sdo(expedited_download(index, subindex, data))
        return None if answer[0] == 0x60 else int.from_bytes(answer[4:], 'little')

    def read(self, index, subindex=0):
        """Return the value of an object, or None if the drive aborts."""
        low_byte = index & 0xFF
        high_byte = index >> 8
        request = bytes([0x40, low_byte, high_byte, subindex, 0, 0, 0, 0])
        answer = self.sdo(request)
        if answer[0] == 0x80:
            return None
        size = 4 - (answer[0] >> 2 & 3)
        variable = self.drive.objects.variables[index, subindex]
        return variable.decode_raw(bytes(answer[4 : 4 + size]))

    def emergencies(self):
        found = []
        for cob_id, data in self.sent:
            if cob_id == 0x80 + NODE:
                found.append(Emergency(*struct.unpack('<HB5s', data)))
        return found

    # --- the life of a drive

    def boot(self):
        self.wait(0.06)
        return self

    def configure(self, home_position=0, **changes):
        """Boot, write all objects, start; changes by name, such as ``_6098=37``."""
        self.boot()
        controller = ControllerSettings(rate=round(1.0 / PERIOD))
        for write in drive_writes(self.profile, self.profile.applied(AXIS), controller):
            assert self.write(*write[:4]) is None, write
        values = {self.profile.location('home_position'): home_position}
        values[0x6084, 0] = round(2.0 * CPM)  # slower than the quick stop of 6085h
        for name, value in changes.items():
            values[int(name[1:], 16), 0] = value
        for place, value in values.items():
            assert self.write(*place, value) is None, place
        self.nmt(NMT_START)
        return self

    def cycle(self, count=1):
        """Send RPDO1, wait for the next SYNC, and store the answer."""
        for _ in range(count):
            if self.sends_heartbeat:
                self.send(0x77F, [5])
            self.send(
                0x200 + NODE, encode_rpdo1(self.controlword, self.mode, self.target)
            )
            self.wait(PERIOD)
            self.sync()
        return self.status

    def sync(self):
        answer = dict(self.send(0x80))
        if 0x180 + NODE in answer:
            self.status = decode_tpdo1(answer[0x180 + NODE])
            self.motion = decode_tpdo2(answer[0x280 + NODE])
        return answer

    @property
    def state(self):
        return decode_state(self.status.statusword)

    def go(self, goal, cycles=20):
        """Command the state machine up to a state; on the way down the power goes off at once."""
        self.cycle(2)
        while self.state is not goal and cycles:
            self.controlword = WAY_UP.get(self.state, Controlword.DISABLE_VOLTAGE)
            self.cycle(2)
            cycles -= 1
        assert self.state is goal
        return self

    def enable(self, mode=Mode.CYCLIC_SYNCHRONOUS_POSITION):
        self.mode = mode
        self.cycle(2)
        self.target = self.status.position_counts
        return self.go(State.OPERATION_ENABLED)

    def command(self, *bits):
        self.controlword = Controlword.ENABLE_OPERATION | sum(bits)
        return self.cycle(2)

    def until(self, condition, cycles=3000):
        """Run cycles until a condition holds, or fail after a number of cycles."""
        while not condition():
            assert cycles, 'the condition does not hold in time'
            cycles -= 1
            self.cycle()
        return self

    def move_at(self, speed, cycles=50):
        """Move the target at a speed [m/s]."""
        for _ in range(cycles):
            self.target += round(speed * CPM * PERIOD)
            self.cycle()
        return self
