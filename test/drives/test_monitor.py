"""What is believed of one drive's answers; no bus, no clock."""

from __future__ import annotations

from dataclasses import replace

import pytest

from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.emergency import Fault
from facade_manipulator.canopen.pdo import TPDO1, TPDO2, TPDO3
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.monitor import AxisMonitor
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import Mode

AXIS, SETTINGS = AxisSettings(), ControllerSettings()
T, OPERATION_ENABLED = SETTINGS.period, 0x0027
SPEED = 0.4  # m/s


@pytest.fixture
def monitor():
    made = AxisMonitor('q1', AXIS, SETTINGS)
    made.begin_supervision(0.0)
    made.encoder.end_homing(True)
    return made


def monitor_of(**details):
    return AxisMonitor('q1', AXIS, SETTINGS, replace(load_profile('simulated'), **details))


def answer(monitor, time, position, velocity=SPEED, word=OPERATION_ENABLED):
    """Let the drive answer a SYNC; return why all must stop."""
    counts, speed = AXIS.to_counts(position), AXIS.to_counts(velocity)
    cause = monitor.receive_tpdo(TPDO1, TPDO1.codec.pack(
        word, Mode.CYCLIC_SYNCHRONOUS_POSITION, counts), time, time)
    return cause or monitor.receive_tpdo(
        TPDO2, TPDO2.codec.pack(speed, 0), time, time)


def test_answer_is_complete_with_every_tpdo_of_sync(monitor):
    """Else the following error of one cycle is compared with another drive's of the next."""
    answer(monitor, T, 0.0)
    monitor.end_cycle(T)
    status = bytes(TPDO1.codec.size)
    monitor.receive_tpdo(TPDO1, status, 2 * T, 2 * T)
    assert monitor.answers.newest == T
    monitor.receive_tpdo(TPDO2, bytes(TPDO2.codec.size), 2 * T, 2 * T)
    assert monitor.answers.newest == 2 * T


def turns(monitor, words):
    """Let the drive answer a SYNC with each of some statuswords; return the last feedback."""
    for number, word in enumerate(words, 1):
        answer(monitor, number * T, 0.0, 0.0, word)
        feedback = monitor.end_cycle(number * T)
    return feedback


GOOD, LIMITED, LOCAL, IGNORES = 0x1227, 0x1A27, 0x1027, 0x0227


@pytest.mark.parametrize(('words', 'says'), [
    ((GOOD,) * 5, ''),
    ((GOOD, IGNORES), 'bit 12 is 0'),
    ((GOOD, LOCAL), 'bit 9 is 0'),
    ((LOCAL, LOCAL), ''),  # a drive that has no such bit
    ((GOOD, LIMITED), ''),  # who catches up may be at his limits
    ((GOOD, 0x0250), ''),  # not enabled: it need not
])
def test_drive_that_reports_disobedience_is_believed(monitor, words, says):
    assert says in turns(monitor, words).disobedience
    assert monitor.is_limited is (words[-1] == LIMITED)
    assert bool(says) is bool(turns(monitor, words).disobedience)


@pytest.mark.parametrize('step', [0.3, 9.0])
def test_clock_set_forward_makes_no_drive_silent(
        monitor, step):
    silence = {}
    for number in range(1, 40):
        now = 0.05 * number
        late = step if number == 20 else 0.0
        monitor.receive_heartbeat(Frame(0x701, b'\x05', now - late, now))
        silence[number] = monitor.silence(now)
    assert not any(silence.values())
    assert 'q1 (node 1) sent no heartbeat for 200 ms, bound 150 ms' == (
        monitor.silence(now + 0.2).message)


def test_carriage_at_rest_has_constant_positions(monitor):
    for cycle in range(1, 5):
        answer(monitor, cycle * T, 0.004 * cycle * T, velocity=0.0)
        assert monitor.end_cycle(cycle * T).at_rest is (cycle == 1)
    answer(monitor, 5 * T, 0.016 * T, velocity=0.0)
    assert monitor.end_cycle(5 * T).at_rest


FAULTY = 0x0008


def beat(state):
    return lambda monitor: monitor.receive_heartbeat(Frame(0x701, bytes([state]), 1.0, 1.0))


def emergency(code):
    data = code.to_bytes(2, 'little') + bytes(6)
    return lambda monitor: monitor.receive_emergency(Frame(0x081, data, 1.0, 1.0))


def error_code(statusword, code):
    def say(monitor):
        monitor.receive_tpdo(TPDO1, TPDO1.codec.pack(statusword, 8, 0), T, T)
        return monitor.receive_tpdo(TPDO3, TPDO3.codec.pack(code, 0, 0), T, T)
    return say


def miss(count):
    def say(monitor):
        for cycle in range(count):
            monitor.end_cycle(cycle * T)
        return monitor.silence(0.0)
    return say


def jump(monitor):
    answer(monitor, T, 0.0)
    return answer(monitor, 2 * T, 0.1)


@pytest.mark.parametrize(('say', 'words', 'asks', 'homed'), [
    (jump, 'the position has jumped', {'home_again', 'cut_power'}, False),
    (beat(5), None, set(), True),
    (beat(0x7F), 'is no longer operational (NMT state 127)', set(), True),
    (beat(0), 'restarted by itself', {'configure_again'}, False),
    (emergency(0x2310), 'current', set(), True), (emergency(0), None, set(), True),
    (emergency(0x7380), 'position is lost', {'home_again', 'cut_power'}, False),
    (error_code(FAULTY, 0x2310), 'current', set(), True),
    (error_code(FAULTY, 0), None, set(), True), (error_code(0x0027, 0x2310), None, set(), True),
    (miss(SETTINGS.max_missed_cycles - 1), None, set(), True),
    (miss(SETTINGS.max_missed_cycles), 'cycles in a row',
     {'configure_again', 'is_vague'}, True)])
def test_messages_of_a_drive_stop_with_a_remedy(monitor, say, words, asks, homed):
    cause = say(monitor)
    assert cause is None if words is None else words in cause.message and cause.axis == 'q1'
    said = vars(cause) if cause else {}
    assert {name for name, value in said.items() if value is True} == asks
    assert monitor.encoder.homed is homed
    monitor.end_supervision()
    assert say(monitor) is None


def test_warning_stops_nothing_until_the_drive_faults():
    """
    Warnings are emergency messages to Kollmorgen (AKD, 1080h, 3180h, 4390h) and Faulhaber.

    Faulhaber's 43F0h (communications manual 7000.05050, table 9) says 'current' in 1001h, so that
    register is no help; other makers set bit 7 of the statusword alone, which stops nothing.
    """
    warm = Fault('it is warm', 'let it cool', is_warning=True)
    monitor = monitor_of(errors={0x43F0: warm})
    monitor.begin_supervision(0.0)
    assert emergency(0x43F0)(monitor) is None
    warned = monitor.snapshot(None, T)
    assert warned.warning == 'it warns: it is warm (error code 43F0h): let it cool'
    assert warned.error_code == 0
    assert error_code(FAULTY, 0x43F0)(monitor).message.startswith('q1 (node 1): it is warm')
    emergency(0)(monitor)
    assert monitor.warning == ''
    assert emergency(0x4310)(monitor) is not None
