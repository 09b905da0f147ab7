"""Commands of docs/commissioning.md, from new drives to drives that home and move."""

from pathlib import Path
import re
import shlex

from bus_world import Rig
import pytest
from tools.commissioning.rig import SERIALS

import facade_manipulator
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.package_files import config_path
from facade_manipulator.tools.commissioning.__main__ import _parser, STEPS
from facade_manipulator.tools.commissioning.procedure import Context

PAGE = (
    Path(facade_manipulator.__file__).parents[1] / 'docs' / 'commissioning.md'
).read_text()
PREFIX = 'ros2 run facade_manipulator commission'
NEW = (
    '--new --directions 1 -1 1 --leads 0.02 0.02 0.01 --start-positions -0.1 0.1 -0.05'
).split()


BLOCK = rf'```\n((?: *{PREFIX}[^\n]*\n)+) *```\n(?:\s*```text\n(.*?)```)?'


def steps():
    """Yield the commands of each block, and the lines that the page shows for them."""
    for block, shown in re.findall(BLOCK, PAGE, re.DOTALL):
        lines = [line.strip() for line in block.splitlines()]
        commands = [shlex.split(line.removeprefix(PREFIX)) for line in lines]
        yield commands, [line.strip() for line in shown.splitlines()]


@pytest.mark.long
def test_commissioning_page_leads_to_a_machine_that_homes(make_rig, capsys):
    rig = make_rig(*NEW)
    rig.drives[1].objects.stored[0x6084, 0] = 12345  # changed by a previous user
    rig.power_cut()

    def axis_of(found):
        return AXIS_NAMES[SERIALS.index(int(found[1]))]

    rig.answers = {'serial number ([0-9]+)': axis_of}
    for commands, shown in steps():
        for words in commands:
            if words[:1] == ['direction']:
                rig.push(AXIS_NAMES.index(words[1]), 3.0)
            mark = rig.places
            number = AXIS_NAMES.index(words[1]) if words[:1] == ['lead'] else 0
            rig.answers['on the ruler'] = lambda _, mark=mark, number=number: (
                f'{1e3 * (rig.places[number] - mark[number]):.2f}'
            )
            is_first = words == ['scan'] and 'assign' not in rig.overlay.steps()
            assert rig.run(*words, yes=False) == int(is_first)
        said = ''.join(capsys.readouterr())
        for line in shown:
            pattern = '.*'.join(map(re.escape, line.split('…')))
            assert re.search(pattern, said), f'{commands}: {line!r} is not in\n{said}'
    assert rig.overlay.steps().keys() >= {*STEPS}
    axes = Context(_parser().parse_args([])).axes
    assert [axis.direction for axis in axes.values()] == [1, -1, 1]
    leads = [axis.lead for axis in axes.values()]
    assert leads == pytest.approx([0.02, 0.02, 0.01], rel=2e-3)
    for drive, place in zip(rig.drives, (-0.1, 0.1, 0.03), strict=True):
        drive.motor.place(place)  # parked beside the switch that q3 searches for
    machine = Rig(axes=tuple(axes.values()), drives=rig.drives)
    machine.request('configure', 'home', 'activate')
    assert machine.state is ControllerState.ACTIVE
    machine.stream()
    machine.run(2.0)
    assert machine.state is ControllerState.ACTIVE


def test_profile_in_the_documentation_matches_the_drives(make_rig, tmp_path):
    (text,) = re.findall(r'```yaml\n(vendor_id: 0.*?)```', PAGE, re.DOTALL)
    (tmp_path / 'my_drive.yaml').write_text(text)
    (tmp_path / 'cia402.eds').write_text(config_path('drives/cia402.eds').read_text())
    profile = str(tmp_path / 'my_drive.yaml')
    rig = make_rig('--profile', profile).configured(profile)
    assert rig.run('profile', '--check') == 0
