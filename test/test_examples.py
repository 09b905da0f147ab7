"""Supervisors in docs/examples: strokes, pressing, faults, a restarted driver, shutdown."""

import os
from pathlib import Path
import signal
import subprocess
import time

import pytest
from stack import begun
from support import children, wait_until

import facade_manipulator
from facade_manipulator import config_path
from facade_manipulator.client import ManipulatorClient

FOLDER = Path(facade_manipulator.__file__).parents[1] / 'docs/examples'
CLIENT = 'supervisor_with_client'
RCLPY = 'supervisor_with_rclpy'
# both examples recover by the same steps, and each run takes half a minute
of_client = pytest.mark.parametrize('begin', [CLIENT], indirect=True)
of_rclpy = pytest.mark.parametrize('begin', [RCLPY], indirect=True)
QUESTION = 'then press Enter'
FREEZE = 1.0  # s, far beyond what drives forgive
LONG = 90.0  # s; a crashed publisher of driver/status counts for up to 20 s

if not FOLDER.is_dir():
    pytest.skip('the examples exist only in the source tree', allow_module_level=True)


class Operator:
    """Operator of an example: reads its output, and presses Enter at its questions."""

    def __init__(self, start_process, name: str, *arguments: str) -> None:
        self.process = start_process(
            name,
            *arguments,
            env={'PYTHONPATH': str(FOLDER)},
            stdin=subprocess.PIPE,
            text=True,
        )
        self.answers = 0

    def output(self) -> str:
        return self.process.log.read_text()

    def confirm(self) -> None:
        """Press Enter once for each question without an answer."""
        if self.output().count(QUESTION) > self.answers:
            self.answers += 1
            self.process.stdin.write('\n')
            self.process.stdin.flush()
        time.sleep(0.05)  # a loop without a pause would need a whole processor

    def confirm_until(self, words: str) -> None:
        """Press Enter at each question until words are in the output."""

        def has_happened():
            return words in self.output() or self.process.poll() is not None

        wait_until(has_happened, f'"{words}"', LONG, self.confirm)
        assert words in self.output()

    def confirm_until_end(self) -> None:
        wait_until(
            lambda: self.process.poll() is not None, 'the end', LONG, self.confirm
        )
        assert self.process.returncode == 0, self.output()
        assert driver_state() == 'unconfigured'


@pytest.fixture
def start_driver(start_process):
    """Return a function that starts a driver with simulated drives."""

    def start() -> subprocess.Popen:
        process = start_process(
            'facade_manipulator.nodes.driver',
            '--ros-args',
            '--params-file',
            str(config_path('simulation.yaml')),
        )
        return begun(process, 'ready')

    return start


@pytest.fixture
def driver(start_driver, start_process):
    """Return a driver beside compensator and ik_service."""
    start_process(
        'facade_manipulator.nodes.manipulator',
        *('--ros-args', '-p', 'contact.yaw_enabled:=true'),
    )
    return start_driver()


@pytest.fixture
def begin(request, start_process, ros):
    """
    Return a function that starts an example with arguments, up to its first question.

    The driver is unconfigured before the first confirmation and after the end of each run.
    """

    def start(*arguments: str) -> Operator:
        operator = Operator(start_process, request.param, *arguments)
        wait_until(lambda: QUESTION in operator.output(), 'the first question')
        assert driver_state() == 'unconfigured'
        return operator

    return start


def driver_state() -> str:
    with ManipulatorClient(node_name='observer') as client:
        return client.driver_state()


@of_rclpy
def test_example_continues_after_a_confirmed_fault(driver, begin):
    operator = begin('--strokes', '2')
    operator.confirm_until('stroke 1 of')
    (loop,) = children(driver.pid)
    os.kill(loop, signal.SIGSTOP)
    time.sleep(FREEZE)
    os.kill(loop, signal.SIGCONT)
    operator.confirm_until_end()
    assert '\nclear_faults\nactivate\n' in operator.output()
    assert 'stroke 2 of 2' in operator.output()


@of_client
def test_example_continues_with_a_restarted_driver(driver, start_driver, begin):
    operator = begin('--strokes', '2')
    operator.confirm_until('stroke 1 of')
    os.kill(driver.pid, signal.SIGKILL)
    wait_until(lambda: driver.poll() is not None, 'the end of the driver')
    start_driver()
    operator.confirm_until_end()
    assert operator.output().count('\nconfigure\nhome\nactivate\n') == 2


@of_client
def test_example_presses_on_the_wall(driver, begin, start_process):
    start_process(
        'facade_manipulator.simulation.gondola_simulator',
        *('--ros-args', '-p', f'scenario:={config_path("scenarios/pressing.yaml")}'),
    )
    operator = begin('--strokes', '2', '--pressing')
    operator.confirm_until_end()
    assert 'stroke 2 of 2' in operator.output()
