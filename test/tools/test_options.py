"""Options of the tools that are numbers."""

from __future__ import annotations

import pytest

from facade_manipulator.tools.calibration.__main__ import main as calibrate


@pytest.mark.parametrize('value', ['nan', 'inf', '0', '-3'])
@pytest.mark.parametrize(('main', 'arguments'), [
    (calibrate, ['measure', 'plan.csv', '--enough', '0.1', '{}'])])
def test_a_duration_or_an_accuracy_is_a_finite_number_above_0(main, arguments, value, capsys):
    with pytest.raises(SystemExit, match='2'):
        main([one.format(value) for one in arguments])
    assert f'{value} is no finite number above 0' in capsys.readouterr().err
