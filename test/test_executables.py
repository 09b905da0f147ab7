"""Executables without the packages of an extra, and with files that cannot be used."""

import errno
from importlib.metadata import entry_points
import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

import pytest
from support import DEADLINE

from facade_manipulator import executables
from facade_manipulator.command_line import EXTRA_OF
from facade_manipulator.errors import file_sentence

NODES = (
    'driver',
    'ik_service',
    'compensator',
    'manipulator',
    'disturbance_estimator',
    'gondola_simulator',
)
RUNS = [  # executable and arguments
    *([node, '--help'] for node in NODES),
    ['drive_simulator', '--help'],
    ['commission', '--help'],
    ['stopping'],
    ['calibrate', 'poses', '--count', '8'],
    ['calibrate', 'geometry', 'table.csv'],
    ['calibrate', 'estimator', 'recording'],
    ['demo', '--help'],
    ['demo', '--duration', '1'],
    ['workspace_study', '--table2'],
    ['workspace_study', '--figures', 'pictures'],
    ['workspace_study', '--optimise', 'area', '--scheduler', 'tcp://127.0.0.1:9'],
]
NEEDED = {  # runs that need a package; others may need it
    'matplotlib': ['demo --help', 'workspace_study --figures pictures'],
    'PIL': ['demo --help'],
    'rich': ['workspace_study --table2'],
    'scipy': ['calibrate geometry table.csv'],
    'rosbags': ['calibrate estimator recording'],
    'mujoco': ['gondola_simulator --help', 'demo --duration 1'],
    'distributed': [
        'workspace_study --optimise area --scheduler tcp://127.0.0.1:9',
    ],
    'rclpy': [*(f'{node} --help' for node in NODES), 'demo --help'],
}
CODE = """
import contextlib, io, json, sys
package, *runs = json.loads(sys.argv[1])
sys.modules[package] = None  # importing it raises a ModuleNotFoundError
from facade_manipulator import executables
found = {}
for run in runs:
    sys.argv = run
    errors = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        try:
            status = getattr(executables, run[0])()
        except SystemExit as end:
            status = end.code
    found[' '.join(run)] = status, errors.getvalue()
print(json.dumps(found))
"""


def run_without(package, folder, runs):
    """Return exit status and standard error of executables without a package, by their words."""
    command = [sys.executable, '-c', CODE, json.dumps([package, *runs])]
    done = subprocess.run(
        command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def write_table(folder):
    """Write a table of measured poses for `calibrate geometry`."""
    command = [sys.executable, '-m', 'facade_manipulator.tools.calibration', 'poses']
    done = subprocess.run(
        command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True
    )
    poses = done.stdout.splitlines()
    rows = [poses[0]]
    for row in poses[1:]:
        cells = row.split(',')
        x, y, sine = (float(cell) for cell in cells[:3])
        angle = 2.0 * sine / 0.01745329
        rows.append(','.join([*cells[:7], f'{1e3 * x}', f'{1e3 * y}', f'{angle}']))
    (folder / 'table.csv').write_text('\n'.join(rows))


@pytest.fixture(scope='module')
def measured(tmp_path_factory):
    """Return a folder with a table of measured poses."""
    folder = tmp_path_factory.mktemp('measured')
    write_table(folder)
    return folder


@pytest.mark.long
@pytest.mark.parametrize('package', NEEDED)
def test_executable_names_the_extra_of_a_missing_package(measured, package):
    needing = NEEDED[package]
    runs = [run for run in RUNS if ' '.join(run) in needing or len(run) < 3]
    found = run_without(package, measured, runs)
    sentence = f'the Python package {package} is not installed; next: '
    extra = f'the extra {EXTRA_OF.get(package, "ros")} of facade_manipulator'
    for words in needing:
        status, error = found[words]
        assert status != 0 and sentence in error and extra in error, error
    for words, (status, error) in found.items():
        assert status == 0 or sentence in error, f'{words}: {error}'
        assert 'Traceback' not in error


@pytest.mark.realtime
@pytest.mark.parametrize('name', ['driver', 'commission', 'stopping'])
@pytest.mark.parametrize('delay', [0.05, 0.2, 0.5])
def test_interrupt_during_the_import_prints_no_traceback(tmp_path, name, delay):
    code = (
        'import sys\n'
        'from facade_manipulator import executables\n'
        'sys.argv = sys.argv[1:]\n'
        'print("starting", flush=True)\n'
        'sys.exit(getattr(executables, sys.argv[0])())\n'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', code, name, '--help'],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        text=True,
    )
    assert process.stdout.readline() == 'starting\n'
    time.sleep(delay)  # the moment of the interrupt
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=DEADLINE)
    assert 'Traceback' not in errors
    # an interpreter that is about to end has the default action of the signal again
    assert process.returncode in (0, executables.INTERRUPTED, -signal.SIGINT)


def test_extras_install_the_packages_that_messages_name():
    text = (Path(__file__).parents[1] / 'setup.py').read_text()
    for package, extra in EXTRA_OF.items():
        section = re.search(rf"^    '{extra}': \[(.*?)^    \]", text, re.M | re.S)[1]
        name = {'PIL': 'Pillow'}.get(package, package)
        assert f"'{name}>=" in section


def test_every_executable_has_an_entry_point():
    scripts = set()
    for script in entry_points(group='console_scripts'):
        if script.value.startswith('facade_manipulator.'):
            scripts.add(script.name)
    assert scripts == {words[0] for words in RUNS}
    assert all(callable(getattr(executables, name)) for name in scripts)


@pytest.mark.parametrize('number', sorted(errno.errorcode))
def test_file_failure_is_a_sentence_with_its_path(number):
    sentence = file_sentence(OSError(number, os.strerror(number), '/user/own.yaml'))
    assert re.fullmatch(r'/user/own\.yaml rejected: .+; next: .+', sentence)
    assert 'Errno' not in sentence


UNUSABLE = ['nowhere.yaml', 'folder.yaml', 'file.yaml/below.yaml', 'bad.yaml']
OF_FILES = {  # executables that read or write a file of the user, with its place
    'stopping': ['{}'],
    'calibrate': ['poses', '--parameters', '{}'],
    'commission': ['scan', '--yes', '--parameters', '{}'],
    'drive_simulator': ['--interface', 'virtual', '--profile', '{}'],
    'gondola_simulator': ['--ros-args', '-p', 'scenario:={}'],
    'demo': ['--scenario', '{}'],
    **{node: ['--ros-args', '--params-file', '{}'] for node in NODES[:-1]},
}


# One import serves all files: each run is a fork, and so the first run of its process.
OF_FILES_CODE = """
import json, os, sys
from importlib import import_module
from facade_manipulator import executables
name = sys.argv[1]
os.environ.update(executables.SETTINGS)
main = getattr(executables, name)
import_module(f'facade_manipulator.{main.args[1]}')
found = []
for arguments in json.loads(sys.argv[2]):
    errors = os.open('errors', os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    child = os.fork()
    if child == 0:
        os.dup2(errors, 2)
        sys.argv = [name, *arguments]
        raise SystemExit(main())
    _, status = os.waitpid(child, 0)
    with open(errors) as text:
        text.seek(0)
        found.append([os.waitstatus_to_exitcode(status), text.read()])
print(json.dumps(found))
"""
#: nodes that read their files as the driver does
ALIKE = {*NODES} - {'driver', 'gondola_simulator'}


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.parametrize('name', OF_FILES)
def test_executable_names_the_file_that_it_cannot_use(name, ros_domain, tmp_path):
    (tmp_path / 'folder.yaml').mkdir()
    (tmp_path / 'file.yaml').touch()
    (tmp_path / 'bad.yaml').write_text('[')
    files = UNUSABLE[:1] if name in ALIKE else UNUSABLE
    runs = []
    for file in files:
        runs.append([word.format(file) for word in OF_FILES[name]])
    command = [sys.executable, '-c', OF_FILES_CODE, name, json.dumps(runs)]
    done = subprocess.run(
        command, cwd=tmp_path, stdout=subprocess.PIPE, text=True, check=True
    )
    found = json.loads(done.stdout.splitlines()[-1])
    for file, (status, errors) in zip(files, found, strict=True):
        line = [line for line in errors.splitlines() if file in line][-1]
        assert status in (1, 2) and line.count('next: ') == 1, errors
        assert not re.search(r'Errno|Traceback|\.c:|/src/', errors), errors


def test_closed_pipe_ends_a_tool_silently():
    reader, writer = os.pipe()
    os.close(reader)  # as `head` does after its last line
    with os.fdopen(writer, 'wb') as output:
        command = [sys.executable, '-m', 'facade_manipulator.tools.stopping']
        done = subprocess.run(command, stdout=output, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 141
    assert done.stderr.splitlines()[1:] == []  # only the names of the files


@pytest.mark.parametrize('name', [*NODES, 'demo'])
def test_executable_names_the_variable_of_another_middleware(name, monkeypatch, capsys):
    monkeypatch.setattr(executables, 'find_spec', lambda _: 'wheels of ROS 2')
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_cyclonedds_cpp')
    assert getattr(executables, name)() == 2
    error = capsys.readouterr().err
    assert f'{name}: RMW_IMPLEMENTATION=rmw_cyclonedds_cpp rejected' in error
    assert 'next: unset RMW_IMPLEMENTATION' in error


GRAPHICS = ('MUJOCO_GL', 'PYOPENGL_PLATFORM', 'MPLBACKEND', 'QT_QPA_PLATFORM')


@pytest.mark.parametrize(
    'values',
    [
        ('egl', 'egl', 'TkAgg', 'xcb'),
        pytest.param(
            ('osmesa', 'osmesa', 'of_mine', 'of_mine'), marks=pytest.mark.long
        ),
        pytest.param(('glfw', 'of_mine', 'TkAgg', 'of_mine'), marks=pytest.mark.long),
        ('of_mine', 'of_mine', 'of_mine', 'of_mine'),
    ],
)
def test_simulation_starts_with_graphics_settings_of_others(values):
    code = (
        'import sys\n'
        'from facade_manipulator import executables\n'
        'sys.argv = ["demo", "--help"]\n'
        'try:\n'
        '    executables.demo()\n'
        'finally:\n'
        '    import facade_manipulator.simulation.world.world\n'
    )
    environment = os.environ | dict(zip(GRAPHICS, values, strict=True))
    subprocess.run([sys.executable, '-c', code], env=environment, check=True)
