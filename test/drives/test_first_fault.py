"""First fault of a process: nothing is loaded before the drives are commanded to stop."""

import json
from pathlib import Path
import subprocess
import sys

from drives.first_fault import FAULTS
import pytest

pytestmark = pytest.mark.long

SCRIPT = Path(__file__).parent / 'first_fault.py'
# An ordinary turn has up to 300 calls; reading the table of error codes has 40,000.
MOST_CALLS = 1000


@pytest.fixture(scope='module')
def results():
    """Return the computation of each fault by its name."""
    output = subprocess.check_output([sys.executable, SCRIPT], text=True)
    found = {}
    for line in output.splitlines():
        if line.startswith('{'):
            result = json.loads(line)
            found[result['name']] = result
    return found


@pytest.mark.parametrize('name', FAULTS)
def test_first_fault_loads_nothing_before_the_stop(results, name):
    result = results[name]
    assert result['cause']
    assert result['loaded'] == []
    assert result['calls'] < MOST_CALLS
