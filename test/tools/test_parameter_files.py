"""Every tool finds, names and checks the parameter files of a machine in the same way."""

from nodes.node_rig import NODES
import pytest

from facade_manipulator.nodes.node_settings import OF_ROS, parameter_names
from facade_manipulator.package_files import config_path, machine_files
from facade_manipulator.tools import stopping
from facade_manipulator.tools.calibration import __main__ as calibrate
from facade_manipulator.tools.commissioning import __main__ as commission
from facade_manipulator.tools.parameter_files import read_machine


def run_stopping(*files):
    return stopping.main([*files])


def run_calibrate(*files):
    parameters = ['--parameters', *files] if files else []
    return calibrate.main(['poses', '--count', '4', *parameters])


def run_commission(*files):
    parameters = ['--parameters', *files] if files else []
    return commission.main(['scan', '--yes', *parameters])


TOOLS = {
    'stopping': run_stopping,
    'calibrate': run_calibrate,
    'commission': run_commission,
}
OWNER = {'stopping': 'driver', 'calibrate': 'compensator', 'commission': 'driver'}
UNKNOWN = {  # content of a file, and the name in the message
    'group': (
        '/**/{owner}: {{ros__parameters: {{limts: {{speed: 0.2}}}}}}',
        'limts.speed',
    ),
    'name': (
        '/**/{owner}: {{ros__parameters: {{geometry: {{gap: 0.2}}}}}}',
        'geometry.gap',
    ),
    'plain name': ('/**/{owner}: {{ros__parameters: {{raet: 0.2}}}}', 'raet'),
    'group of all nodes': (
        '/**: {{ros__parameters: {{geometri: {{a: 0.2}}}}}}',
        'geometri.a',
    ),
    'name of all nodes': (
        '/**: {{ros__parameters: {{geometry: {{gap: 0.2}}}}}}',
        'geometry.gap',
    ),
}


@pytest.mark.parametrize('tool', TOOLS)
@pytest.mark.parametrize('path', ['.', '', '..', '/'])
def test_tool_rejects_folder_as_parameter_file(
    tmp_path, monkeypatch, capsys, tool, path
):
    monkeypatch.chdir(tmp_path)
    assert TOOLS[tool](path) == 1
    assert 'it is a folder; next: name a file' in capsys.readouterr().err


@pytest.mark.parametrize('tool', TOOLS)
@pytest.mark.parametrize('mistake', UNKNOWN)
@pytest.mark.parametrize('file', ['manipulator.yaml', 'machine.yaml'])
def test_tool_rejects_unknown_name_with_its_file(
    tmp_path, monkeypatch, capsys, tool, mistake, file
):
    monkeypatch.chdir(tmp_path)
    text, name = UNKNOWN[mistake]
    (tmp_path / file).write_text(text.format(owner=OWNER[tool]) + '\n')
    assert TOOLS[tool]() != 0
    error = capsys.readouterr().err
    assert f'{file} rejected: ' in error
    assert f"parameter '{name}'" in error


@pytest.mark.parametrize('tool', TOOLS)
@pytest.mark.parametrize('given', [[], ['gondola_1/manipulator.yaml']])
def test_tool_names_machine_file_beside_the_parameter_file(
    tmp_path, monkeypatch, capsys, tool, given
):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / 'gondola_1' if given else tmp_path
    folder.mkdir(exist_ok=True)
    (folder / 'manipulator.yaml').write_text('')
    (folder / 'machine.yaml').write_text('')
    TOOLS[tool](*given)
    beside = 'gondola_1/' if given else ''
    shown = (
        f'{tool}: parameters of {beside}manipulator.yaml, then {beside}machine.yaml\n'
    )
    assert shown in capsys.readouterr().err


def test_stopping_computes_with_machine_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    section = '/**/driver: {ros__parameters: {controller: {drive_lag: 0.04}}}\n'
    (tmp_path / 'machine.yaml').write_text(section)
    assert stopping.main([]) != 0  # the carriages would touch
    slow = capsys.readouterr().out
    (tmp_path / 'machine.yaml').unlink()
    assert stopping.main([]) == 0
    assert slow != capsys.readouterr().out


def test_parameter_of_another_node_is_accepted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = '/**: {ros__parameters: {horizon: 0.06, use_sim_time: false}}\n'
    (tmp_path / 'manipulator.yaml').write_text(text)
    assert stopping.main([]) == 0


def test_given_machine_file_is_read_once_in_given_order(tmp_path):
    own, overlay, last = (
        tmp_path / name
        for name in ('manipulator.yaml', 'machine.yaml', 'simulation.yaml')
    )
    for path in (own, overlay, last):
        path.write_text('')
    assert machine_files([own, last]) == [own, overlay, last]
    assert machine_files([own, last, overlay]) == [own, last, overlay]


@pytest.mark.parametrize('node', NODES)
def test_tools_know_the_parameters_that_the_node_declares(ros, node):
    made = ros.add(NODES[node]())
    declared = set()
    for name in made.list_parameters([], 0).names:
        if name.partition('.')[0] not in OF_ROS:
            declared.add(name)
    assert parameter_names(node, {}) == declared


def test_shipped_files_have_only_known_names():
    files = [config_path('manipulator.yaml'), config_path('simulation.yaml')]
    for node in NODES:
        read_machine(files, node)  # raises no ParameterError
