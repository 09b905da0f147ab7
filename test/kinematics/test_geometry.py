import math

import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.parameters import from_mapping


def test_geometry_accepts_integers_and_zero_gap():
    with_integers = Geometry(stroke=(-1, 1), carriage_gap=0)
    assert with_integers == Geometry(stroke=(-1.0, 1.0), carriage_gap=0.0)


@pytest.mark.parametrize(
    ('fields', 'words'),
    [
        ({'link_length': -0.352}, 'link_length = -0.352 m'),
        ({'link_length': 0.0}, 'link_length = 0 m'),
        ({'link_length': math.nan}, 'link_length = nan'),
        ({'link_length': '0.3 m'}, "link_length = '0.3 m'"),
        ({'platform_half_length': None}, 'platform_half_length = None'),
        ({'platform_half_length': math.inf}, 'platform_half_length = inf'),
        ({'carriage_gap': -0.001}, 'carriage_gap = -0.001 m'),
        ({'carriage_gap': 0.348}, 'not below platform_half_length'),
        ({'carriage_gap': 0.3, 'stroke': (-0.3, 0.3)}, 'no room for three carriages'),
        ({'stroke': (0.5, -0.5)}, 'is empty'),
        ({'stroke': (0.5, 0.5)}, 'is empty'),
        ({'stroke': (-0.5, math.inf)}, 'stroke = inf'),
        ({'stroke': (-0.5, 0.0, 0.5)}, '3 elements, expected 2: minimum, maximum'),
        ({'stroke': 1.0}, 'not a list'),
        ({'stroke': ('a', 'b')}, "stroke = 'a'"),
        ({'link_errors': (0.1, 0.0)}, 'above its maximum'),
        ({'carriage_offsets': (0.0, 0.0)}, '2 elements, expected 3'),
        ({'tool': 'ahead'}, 'not a list'),
        ({'rail_angle': math.nan}, 'not a finite number'),
    ],
)
def test_geometry_out_of_range_is_rejected(fields, words):
    with pytest.raises(ParameterError, match=words):
        Geometry(**fields)


def test_removed_backlash_is_rejected_with_the_reason():
    values = {'backlash': [0.0, 0.0, 0.0]}
    with pytest.raises(
        ParameterError, match="'geometry.backlash', which was removed because no tool"
    ):
        from_mapping(Geometry, values, 'geometry')
