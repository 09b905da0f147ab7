"""Time-outs exceed each other, in the table and wherever a file repeats their numbers."""

from configparser import ConfigParser
from pathlib import Path
import re

from facade_manipulator import timeouts
from facade_manipulator.drives.axis_settings import AxisSettings

TOP = Path(__file__).parents[1]
UNIT = TOP / 'config/deploy/etc/systemd/system/facade-driver@.service'


def service() -> dict[str, str]:
    """Return the section Service of the unit of the driver."""
    unit = ConfigParser(strict=False, interpolation=None)
    unit.read(UNIT)
    return dict(unit['Service'])


def test_each_time_out_exceeds_the_level_below():
    levels = [
        timeouts.RESPONSE_TIMEOUT,
        timeouts.ATTEMPTS * timeouts.RESPONSE_TIMEOUT,
        timeouts.ASKING_TIMEOUT,
        timeouts.CLOSE_REQUEST_TIMEOUT,
        timeouts.END_TIMEOUT,
        timeouts.CLOSE_TIMEOUT,
        timeouts.DRIVER_TIMEOUT,
    ]
    assert levels == sorted(set(levels))


def test_request_close_has_time_for_all_its_steps():
    """The steps are those of `close` in drives/requests.py, one after the other."""
    steps = (
        timeouts.ORDERLY_STOP_TIMEOUT,
        timeouts.STOP_AND_CUT * timeouts.STEP_TIMEOUT,
        timeouts.ASKING_TIMEOUT,
    )
    assert timeouts.CLOSE_REQUEST_TIMEOUT >= sum(steps)


def test_driver_has_time_for_the_slowest_braking():
    needed = timeouts.CLOSE_TIMEOUT + timeouts.braking_time(timeouts.SLOWEST_BRAKING)
    assert timeouts.DRIVER_TIMEOUT > needed
    assert AxisSettings().stop_time <= timeouts.SLOWEST_BRAKING


def test_systemd_waits_as_long_as_the_table():
    assert float(service()['timeoutstopsec']) == timeouts.DRIVER_TIMEOUT


def test_systemd_restarts_driver_after_the_end_of_its_loop():
    longest = timeouts.END_TIMEOUT + timeouts.braking_time(AxisSettings().stop_time)
    assert float(service()['restartsec']) > longest


def test_design_page_names_the_time_out_of_the_loop():
    page = ' '.join((TOP / 'docs/design.md').read_text().split())
    found = re.search(
        r'whose shutdown takes (\S+) s plus (\S+) the longest quick stop', page
    )
    assert found is not None
    assert float(found[1]) == timeouts.END_TIMEOUT
    assert found[2] == {2: 'twice'}[timeouts.STOP_AND_CUT]


def test_launch_waits_as_long_as_the_table():
    launch = (TOP / 'launch/manipulator.launch.py').read_text()
    assert 'sigterm_timeout=str(DRIVER_TIMEOUT)' in launch
