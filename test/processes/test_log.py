"""Log of the control loop, in the format and with the level of the driver's log."""

from pathlib import Path
import re

import pytest

LINE = re.compile(
    r'\[(DEBUG|INFO|WARN|ERROR|FATAL)\] \[\d+\.\d{9}\] \[control loop\]: '
)


@pytest.fixture
def log_of(client, start_process):
    """Return the lines of the control loop of a driver that was started with a level."""

    def lines(level: str) -> list[str]:
        process = start_process(
            'facade_manipulator.nodes.driver',
            '--ros-args',
            '--log-level',
            level,
            *('-p', 'simulate_drives:=true', '-p', 'configure_at_start:=true'),
        )
        client.wait_until(
            lambda: client.status.state == 'inactive', 'the configuration'
        )
        text = Path(process.log).read_text()
        return [line for line in text.splitlines() if 'control loop]' in line]

    return lines


def test_lines_of_the_loop_have_the_format_of_ros(log_of):
    lines = log_of('info')
    assert lines
    assert all(map(LINE.match, lines))


def test_lines_of_the_loop_obey_the_log_level(log_of):
    assert not [line for line in log_of('warn') if '[INFO]' in line]
