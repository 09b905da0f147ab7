"""Simulated drives of any EDS: they run, or the missing objects are named."""

import re

import pytest

from facade_manipulator.canopen import cob_ids
from facade_manipulator.errors import ParameterError
from facade_manipulator.package_files import config_path
from facade_manipulator.simulation.drives.__main__ import _parser, make_drives

SHIPPED = config_path('drives/cia402.eds').read_text()
INDICES = sorted(set(re.findall(r'^\[([0-9A-F]{4})', SHIPPED, re.MULTILINE)))
OPERATIONAL = bytes([1, 0])


def made(*options):
    """Return the drives of these options of `drive_simulator`."""
    return make_drives(_parser().parse_args(options))


def without(text, index):
    """Return the text of an EDS without the sections of an object."""
    sections = re.split(r'^(?=\[)', text, flags=re.MULTILINE)
    return ''.join(one for one in sections if not one.startswith(f'[{index}'))


@pytest.mark.parametrize('index', INDICES)
def test_drive_without_an_object_runs_or_is_rejected(tmp_path, index):
    profile = config_path('drives/simulated.yaml').read_text()
    (tmp_path / 'own.eds').write_text(without(SHIPPED, index))
    path = tmp_path / 'own.yaml'
    path.write_text(re.sub('^eds: .*', 'eds: own.eds', profile, flags=re.MULTILINE))
    try:
        (drive,) = made('--profile', str(path), '--node-ids', '1')
    except ParameterError as error:
        assert f'{index}h' in str(error)
        assert 'next: ' in str(error)
        return
    for cycle in range(20):
        now = 0.02 * cycle
        drive.advance(now)
        drive.receive(cob_ids.NMT, OPERATIONAL, now)
        drive.receive(cob_ids.SYNC, b'', now)


def test_drive_without_heartbeat_consumer_ignores_its_master():
    drive, *_ = made('--missing-objects', '0x1016')
    # boot-up
    assert (cob_ids.HEARTBEAT + drive.node_id, bytes(1)) in drive.advance(0.1)
    assert drive.receive(cob_ids.HEARTBEAT + cob_ids.MASTER_NODE_ID, b'\x05', 0.2) == []
    drive.advance(5.0)
    assert drive.errors == []
