"""Motions whose spectrum is known."""

from dataclasses import replace

import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.lab.gondola import GondolaSettings, Scenario, WindSettings
from facade_manipulator.lab.gondola.motion import load_spectrum, spectrum
from facade_manipulator.lab.gondola.oracle import wind_law

FREQUENCIES = np.arange(0.02, 1.0, 0.02)
DENSITIES = np.column_stack([
    peak / (1.0 + ((FREQUENCIES - at) / 0.03) ** 2)
    for peak, at in ((1e-2, 0.1), (1e-3, 0.2), (5e-3, 0.15))])


def test_a_motion_has_the_power_of_its_spectrum():
    motion = spectrum(FREQUENCIES, DENSITIES, 3)
    values = np.array([motion(time) for time in np.arange(0.0, 2000.0, 0.25)])
    power = 0.02 * (DENSITIES.sum(axis=0) - 0.5 * (DENSITIES[0] + DENSITIES[-1]))
    assert values.var(axis=0) == pytest.approx(power, rel=0.03)
    found = np.abs(np.fft.rfft(values[:, 0])) ** 2
    peak = np.fft.rfftfreq(len(values), 0.25)[np.argmax(found)]
    assert peak == pytest.approx(0.1, abs=0.04)


def test_another_seed_is_another_motion_of_the_same_power():
    one, other = (spectrum(FREQUENCIES, DENSITIES, seed) for seed in (1, 2))
    assert one(7.0) != pytest.approx(other(7.0))
    assert one(7.0) == spectrum(FREQUENCIES, DENSITIES, 1)(7.0)


def test_what_the_wind_makes_of_a_gondola_can_be_given_as_its_spectrum(tmp_path):
    frequencies, power = wind_law(GondolaSettings(), WindSettings())
    step = frequencies[1] - frequencies[0]
    rows = np.column_stack([frequencies, (power / step).T])[::4]
    path = tmp_path / 'spectrum.csv'
    np.savetxt(path, rows, delimiter=',', comments='',
               header='frequency,x_density,y_density,theta_density')
    base = Scenario()
    scenario = base._replace(mission=replace(
        base.mission, motion='spectrum', recording=str(path)))
    motion = scenario.motion()
    values = np.array([motion(time) for time in np.arange(0.0, 2000.0, 1.0)])
    assert values.std(axis=0) == pytest.approx(np.sqrt(power.sum(axis=1)), rel=0.15)


@pytest.mark.parametrize(('text', 'message'), [
    ('frequency,x_density,y_density\n0.1,1,1\n', 'has no column theta_density'),
    ('frequency,x_density,y_density,theta_density\n0.1,1,1,1\n', 'needs 2 rows at least'),
    ('frequency,x_density,y_density,theta_density\n0.2,1,1,1\n0.1,1,1,1\n',
     'must ascend from above 0 Hz, but row 2 has 0.1 Hz'),
    ('frequency,x_density,y_density,theta_density\n0,1,1,1\n0.1,1,1,1\n',
     'but row 1 has 0 Hz'),
    ('frequency,x_density,y_density,theta_density\n0.1,1,1,1\n0.2,1,-2,1\n',
     'y_density = -2 in row 2 is below its minimum 0'),
    ('frequency,x_density,y_density,theta_density\n0.1,a,1,1\n', "x_density = 'a' is not a")])
def test_what_is_no_spectrum_is_told(tmp_path, text, message):
    path = tmp_path / 'spectrum.csv'
    path.write_text(text)
    with pytest.raises(ManipulatorError, match=message):
        load_spectrum(path, 1)
