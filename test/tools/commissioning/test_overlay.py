"""File `machine.yaml`, and `commission` without a command."""

import pytest

from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.parameters import read_parameters
from facade_manipulator.tools.commissioning.__main__ import main, STEPS
from facade_manipulator.tools.commissioning.procedure import Overlay


def test_status_lists_the_steps_and_the_next_command(rig, capsys):
    rig.run()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ['scan', '-']
    assert lines[1].startswith('assign              20')
    assert lines[-1] == 'next: commission scan'
    for step in STEPS:
        rig.overlay.write(step, {})
    rig.run()
    assert capsys.readouterr().out.endswith('next: start the machine\n')


def test_parameter_file_before_the_command_is_used(tmp_path, capsys):
    absent = tmp_path / 'absent.yaml'
    assert main(['--parameters', str(absent), 'scan']) != 0
    assert str(absent) in capsys.readouterr().err


@pytest.mark.parametrize(
    'text',
    [
        b'/**/driver:\r\n  ros__parameters:\r\n    q2: {direction: 1, lead: 0.03}  # mine\r\n',
        b'/gondola_1/driver: {ros__parameters: {q2: {direction: 1, lead: 0.03}}}\n',
    ],
)
def test_overlay_overrides_the_user_file(tmp_path, text):
    own = tmp_path / 'own.yaml'
    target = tmp_path / 'elsewhere.yaml'
    target.write_bytes(text)
    own.symlink_to(target)
    overlay = Overlay(tmp_path / 'machine.yaml')
    overlay.write('direction q2', {'q2.direction': -1})
    assert read_parameters([own, overlay.path], 'driver') == {
        'q2.direction': -1,
        'q2.lead': 0.03,
    }
    assert own.is_symlink()
    assert target.read_bytes() == text


def test_overlay_keeps_its_other_parameters_and_steps(tmp_path):
    overlay = Overlay(tmp_path / 'machine.yaml')
    overlay.path.write_text('/**: {ros__parameters: {geometry: {link_length: 0.36}}}')
    overlay.write('lead q2', {'q2.lead': 0.01})
    overlay.write('direction q2', {'q2.direction': -1})
    parameters = read_parameters([overlay.path], 'driver')
    assert parameters == {
        'geometry.link_length': 0.36,
        'q2.lead': 0.01,
        'q2.direction': -1,
    }
    assert list(overlay.steps()) == ['lead q2', 'direction q2']


def test_parameter_that_the_user_file_overrides_is_rejected(rig, tmp_path, rejected):
    (tmp_path / 'manipulator.yaml').write_text(
        '/**/driver: {ros__parameters: {q1: {lead: 0.02}}}\n'
        '/gondola_1/driver: {ros__parameters: {q1: {lead: 0.02}}}\n'
    )
    rig.overlay.write('lead q1', {})
    said = rejected('lead', 'q1', '--travel', '6', '--measured', '3')
    assert 'q1.lead: 0.01 has no effect: manipulator.yaml overrides it' in said
    assert 'lead q1' not in rig.overlay.steps()


STEPS_OF_COMMANDS = {
    'scan': ('scan',),
    'assign': ('assign', '--serials', '1', '2', '3'),
    'profile --check q1': ('profile', 'q1', '--check'),
    'backup q1': ('backup', 'q1'),
    'direction q1': ('direction', 'q1'),
    'jog q1': ('jog', 'q1', '5'),
    'lead q1': ('lead', 'q1', '--travel', '5', '--measured', '5'),
    'home-switch q1': ('home-switch', 'q1', '--window', '5'),
    'lag': ('lag',),
    'stop-test': ('stop-test',),
}


@pytest.mark.parametrize('step', STEPS_OF_COMMANDS)
def test_repeated_step_that_fails_is_no_longer_done(rig, rejected, step):
    for other in [*STEPS, step]:
        rig.overlay.write(other, {})
    rig.drives[0].is_silent = True
    said = rejected(*STEPS_OF_COMMANDS[step])
    assert step not in rig.overlay.steps()
    assert 'lead q2' in rig.overlay.steps()
    assert f'Written into machine.yaml: {step}: no longer done' in said


def test_failed_step_that_was_never_done_writes_no_file(make_rig, rejected):
    rig = make_rig('--new')
    assert 'Written into machine.yaml: nothing' in rejected('scan')
    assert not rig.overlay.path.exists()


@pytest.mark.parametrize('step', sorted({*STEPS_OF_COMMANDS} - {'scan', 'backup q1'}))
def test_step_that_the_operator_declines_stays_done(rig, rejected, step):
    rig.overlay.write(step, {})
    rig.answers['Do this'] = 'n'
    rejected(*STEPS_OF_COMMANDS[step], yes=False)
    assert step in rig.overlay.steps()


def assign_other_drives(rig, *numbers: int) -> None:
    """Complete all steps for three drives; then replace drives, and assign them."""
    serials = {f'q{number}.serial_number': number for number in (1, 2, 3)}
    rig.overlay.write('assign', serials)
    for step in [*STEPS, *(f'home-switch {axis}' for axis in AXIS_NAMES)]:
        rig.overlay.write(step, {})
    for number in numbers:
        rig.drives[number - 1].objects.defaults[0x1018, 4] = 70 + number
    rig.power_cut()
    words = [str(drive.objects.values[0x1018, 4]) for drive in rig.drives]
    assert rig.run('assign', '--serials', *words) == 0


def test_assign_of_another_drive_requires_its_steps_again(rig, capsys):
    assign_other_drives(rig, 2)
    repeated = [
        'scan',
        'profile --check q2',
        'direction q2',
        'jog q2',
        'home-switch q2',
        'lag',
        'stop-test',
    ]
    left = rig.overlay.steps().keys()
    assert {*STEPS} - left == {*repeated} - {'home-switch q2'}
    assert 'home-switch q2' not in left
    assert {'lead q2', 'backup q2', 'direction q1', 'home-switch q1'} <= left
    said = capsys.readouterr().out
    assert f'another drive moves q2; next: repeat {", ".join(repeated)}' in said


def test_assign_of_the_same_drives_keeps_all_steps(rig):
    assign_other_drives(rig)
    assert rig.overlay.steps().keys() >= {*STEPS}


@pytest.mark.parametrize(
    'text', ['[', 'just words', '/**/driver: {ros__parameters: 3}']
)
def test_overlay_with_another_structure_is_unchanged(rig, rejected, text):
    rig.overlay.path.write_text(text)
    assert 'machine.yaml' in rejected('scan')
    assert rig.overlay.path.read_text() == text


def test_unwritable_overlay_does_not_record_the_step(rig, rejected, capsys):
    rig.overlay.path.with_name('.machine.yaml.part').mkdir()
    rejected('profile', 'q1', '--check')
    rig.overlay.path.with_name('.machine.yaml.part').rmdir()
    assert 'profile q1' not in rig.overlay.steps()
