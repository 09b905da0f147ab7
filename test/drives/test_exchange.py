"""The cyclic exchange: which frames come between which SYNCs."""

from __future__ import annotations

from drive_faults import at_rest
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.drives.states import Controlword, State

RPDOS = tuple(pdo.RPDO1.cob_id(node) for node in (1, 2, 3))
OVERCURRENT = b'\x10\x23' + bytes(6)


def is_quick_stop(frame) -> bool:
    return frame.cob_id in RPDOS and frame.data[0] == Controlword.QUICK_STOP


def test_stop_is_sent_before_the_next_sync(rig):
    at_rest(rig)
    rig.frames()
    rig.controller.stop('enough')
    assert not rig.frames()
    rig.cycles(2)
    frames = rig.frames()
    stop = next(number for number, one in enumerate(frames) if is_quick_stop(one))
    assert pdo.SYNC_COB_ID not in [one.cob_id for one in frames[:stop]]


@pytest.mark.parametrize('share', [0.05, 0.3, 0.78, 0.85, 0.95, 0.99])
def test_stop_shortly_before_sync_waits_for_it(make_rig, share):
    """Else one drive might latch it now and its neighbour a period later, at full speed."""
    rig = make_rig(has_kernel_sync=True)
    at_rest(rig)
    sync, period = rig.bus.next_sync, rig.settings.period
    rig.later(sync + share * period - rig.clock.now,
              lambda: rig.forge(pdo.emergency_cob_id(1), OVERCURRENT))
    rig.frames()
    rig.cycles(4)
    times = [frame.time - sync for frame in rig.frames() if is_quick_stop(frame)][:3]
    assert max(times) - min(times) < 0.01 * period
    assert (times[0] >= period) is (share > 0.8)


def test_drive_ignoring_quick_stop_gets_nmt_stop_once(rig):
    at_rest(rig)
    rig.drives[1].axis.control = lambda controlword: None
    rig.frames()
    rig.controller.stop('enough')
    rig.run(3.0)
    sent = [frame.data for frame in rig.frames() if frame.cob_id == pdo.NMT_COB_ID]
    assert sent == [b'\x02\x02']
    assert State.OPERATION_ENABLED not in rig.drive_states
