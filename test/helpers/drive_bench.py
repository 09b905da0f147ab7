"""A bench for one simulated drive: a master of a few lines that speaks bytes, and a clock."""

from __future__ import annotations

from canopen.objectdictionary import ODVariable
from frames import decode_tpdo1, decode_tpdo2, encode_rpdo1

from facade_manipulator.canopen.emergency import decode_emergency
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.configuration import pdo_writes
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import Controlword, decode_state, Mode, State
from facade_manipulator.drives.units import AxisScale
from facade_manipulator.simulation.drives.drive import SimulatedDrive, SimulatedIdentity
from facade_manipulator.simulation.drives.motor import SimulationSettings

NODE = 2
PERIOD = 0.01
NMT_START, NMT_STOP, NMT_PREOP, NMT_RESET, NMT_RESET_COMMUNICATION = 1, 2, 128, 129, 130
WRITE = {1: 0x2F, 2: 0x2B, 4: 0x23}
CPM = AxisScale().counts_per_metre
WAY_UP = {
    State.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
    State.READY_TO_SWITCH_ON: Controlword.SWITCH_ON,
    State.SWITCHED_ON: Controlword.ENABLE_OPERATION,
}

CONFIGURATION = {
    (0x1016, 1): 127 << 16 | 150, (0x1017, 0): 50, (0x1029, 1): 1, (0x6007, 0): 3, (0x605A, 0): 6,
    (0x605E, 0): 2, (0x6085, 0): round(5 * CPM), (0x6084, 0): round(2 * CPM),
    (0x6065, 0): round(0.02 * CPM), (0x6066, 0): 0,
    (0x607D, 1): round(-0.5 * CPM), (0x607D, 2): round(0.5 * CPM),
    (0x607F, 0): round(0.6 * CPM), (0x6080, 0): round(0.6 * CPM), (0x60C5, 0): round(6 * CPM),
    (0x60C2, 1): 10, (0x60C2, 2): -3,
    (0x6099, 1): round(0.1 * CPM), (0x6099, 2): round(0.02 * CPM), (0x609A, 0): round(1 * CPM),
    (0x607C, 0): 0, (0x30B2, 0): 1000,
}


class Bench:
    """A drive, its time, and every frame that it sent."""

    def __init__(
        self, profile='simulated', identity=None, direction=1, start=0.0, **settings
    ):
        node = NODE
        self.node = node
        self.profile = load_profile(profile) if isinstance(profile, str) else profile
        self.drive = SimulatedDrive(
            AxisSettings(node_id=node, direction=direction, home_position=start,
                         lower_limit=-0.56, upper_limit=0.56),
            SimulationSettings(**settings), self.profile)
        self.drive.set_identity(identity or SimulatedIdentity(1, 2, 3, 4))
        self.now = 0.0
        self.sent = []
        self.controlword = 0
        self.mode = Mode.CYCLIC_SYNCHRONOUS_POSITION
        self.target = 0
        self.sends_heartbeat = False
        self.status = None
        self.motion = None

    # --- frames

    def send(self, cob_id, data=b''):
        answer = self.drive.receive(cob_id, bytes(data), self.now)
        self.sent += answer
        return answer

    def wait(self, seconds):
        """Call the drive whenever it wants to be called."""
        end = self.now + seconds
        answer = []
        while (deadline := max(self.drive.deadline, self.now)) < end:
            self.now = deadline
            answer += self.drive.advance(self.now)
        self.now = end
        answer += self.drive.advance(end)
        self.sent += answer
        return answer

    def nmt(self, command, node=None):
        return self.send(0, [command, self.node if node is None else node])

    def sdo(self, data):
        answer = [frame for cob_id, frame in self.send(0x600 + self.node, data)
                  if cob_id == 0x580 + self.node]
        assert len(answer) == 1
        return answer[0]

    def write(self, index, subindex, value, size=None):
        """Return None, or the abort code."""
        size = size or len(self.variable(index, subindex)) // 8
        payload = (value & (1 << 8 * size) - 1).to_bytes(4, 'little')
        answer = self.sdo(bytes([WRITE[size], index & 0xFF, index >> 8, subindex]) + payload)
        return None if answer[0] == 0x60 else int.from_bytes(answer[4:], 'little')

    def read(self, index, subindex=0):
        """Return the value, a string, or None if the drive aborts."""
        answer = self.sdo(bytes([0x40, index & 0xFF, index >> 8, subindex, 0, 0, 0, 0]))
        if answer[0] == 0x80:
            return None
        if not answer[0] & 0x02:
            return self.read_segments(int.from_bytes(answer[4:], 'little')).decode()
        size = 4 - (answer[0] >> 2 & 3)
        return self.variable(index, subindex).decode_raw(bytes(answer[4:4 + size]))

    def read_segments(self, size):
        data, toggle = b'', 0
        while len(data) < size:
            data += self.sdo(bytes([0x60 | toggle]) + bytes(7))[1:]
            toggle ^= 0x10
        return data[:size]

    def variable(self, index, subindex):
        item = self.drive.objects.object_dictionary[index]
        return item if isinstance(item, ODVariable) else item[subindex]

    def emergencies(self):
        return [decode_emergency(data) for cob_id, data in self.sent if cob_id == 0x80 + self.node]

    # --- the life of a drive

    def boot(self):
        self.wait(0.06)
        return self

    def configure(self, **changes):
        """Boot, write everything, start; changes by name, such as ``_6098=37``."""
        self.boot()
        for write in pdo_writes(self.node, 100):
            assert self.write(*write[:4]) is None
        values = dict(CONFIGURATION)
        values.update({(int(key[1:], 16), 0): value for key, value in changes.items()})
        values[self.profile.location('home_position')] = values.pop((0x607C, 0))
        for (index, subindex), value in values.items():
            assert self.write(index, subindex, value) is None, hex(index)
        self.nmt(NMT_START)
        return self

    def cycle(self, count=1):
        """Send RPDO1, wait for the next SYNC, note the answer."""
        for _ in range(count):
            if self.sends_heartbeat:
                self.send(0x77F, [5])
            self.send(0x200 + self.node,
                      encode_rpdo1(self.controlword, self.mode, self.target))
            self.wait(PERIOD)
            self.sync()
        return self.status

    def sync(self):
        answer = dict(self.send(0x80))
        if 0x180 + self.node in answer:
            self.status = decode_tpdo1(answer[0x180 + self.node])
        if 0x280 + self.node in answer:
            self.motion = decode_tpdo2(answer[0x280 + self.node])
        return answer

    @property
    def state(self):
        return decode_state(self.status.statusword)

    def go(self, goal, cycles=20):
        """Walk the state machine up over the bus; down it is power off at once."""
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
        """Cycle until a condition holds; it does, in simulated time, or the test fails."""
        for _ in range(cycles):
            if condition():
                return self
            self.cycle()
        raise AssertionError(f'not within {cycles} cycles')

    def move_at(self, speed, cycles=50):
        """Make the target run, in m/s."""
        for _ in range(cycles):
            self.target += round(speed * CPM * PERIOD)
            self.cycle()
        return self
