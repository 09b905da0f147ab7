"""A further drive is a file, not code: one of 24 bits whose inputs are inverted, never seen."""

from __future__ import annotations

from dataclasses import replace

from drive_parts import axes_with
import pytest

from facade_manipulator.drives.profile import load_profile, ProfileObject
from facade_manipulator.resources import config_path
from facade_manipulator.simulation.drives.drive import simulated_drives
from facade_manipulator.simulation.drives.motor import SimulationSettings

TURN = 2**24
OBJECT = """
[{key}]
ParameterName={name}
ObjectType=0x7
DataType=0x0007
AccessType={access}
DefaultValue={value}
"""


@pytest.fixture
def axes(tmp_path):
    """Return axes whose drive type is described by two files, and by nothing else."""
    text = config_path('drives/cia402.eds').read_text()
    text += '\n[608F]\nParameterName=Encoder resolution\nObjectType=0x8\nSubNumber=2\n'
    for key, name, access, value in (
            ('608Fsub1', 'Increments', 'ro', TURN), ('608Fsub2', 'Revolutions', 'ro', 1),
            ('2310', 'Inversion of inputs', 'rw', 0), ('1016sub2', 'Heartbeats', 'rw', 0)):
        text += OBJECT.format(key=key, name=name, access=access, value=value)
    (tmp_path / 'fine.eds').write_text(text)
    inverted = ProfileObject(0x2310, 0, 4 << 8, required=True)
    made = axes_with(
        tmp_path, 'generic_cia402', eds='fine.eds', velocity_unit='rpm',
        counts_per_revolution=TURN, vendor_id=0x1234, product_code=24, homing_methods=[23],
        input_polarity={'index': 0x2310, 'subindex': 0, 'shift': 8}, objects=[
            {**one._asdict(), 'subindex': 2 if one.value == 'master_heartbeat' else one.subindex}
            for one in (*load_profile('generic_cia402').objects, inverted)])
    return tuple(replace(axis, homing_method=23, homing_speed=0.1) for axis in made)


def test_further_drive_homes_and_moves(make_rig, axes):
    rig = make_rig(axes=axes, drives=simulated_drives(
        axes, SimulationSettings(home_switch_opens=True)))
    rig.request('configure', 'home')
    edge = -SimulationSettings().home_switch_width / 2.0  # of method 23, and the switch is there
    assert rig.carriages == pytest.approx([edge] * 3, abs=0.01)
    rig.stream()
    rig.request('activate')
    motor, start, counts = rig.drives[0].motor, rig.carriages[0], rig.drives[0].motor.counts
    rig.until(lambda: rig.carriages[0] > start + 0.02)
    assert rig.snapshot.axes[0].velocity > 0.01
    rig.request('deactivate')
    turns = (rig.carriages[0] - start) / axes[0].lead * axes[0].gear_ratio
    assert motor.counts - counts == pytest.approx(turns * TURN, rel=0.01)
    consumers = [drive.objects.values for drive in rig.drives]
    assert all(values[0x1016, 2] for values in consumers)
    rig.request('cleanup')
    rig.until(lambda: not any(values[0x1016, 2] for values in consumers))
