"""ik_service/workspace: the map of the present angle, latched."""

from __future__ import annotations

from mechanism import DESIGN as GEOMETRY
from nav_msgs.msg import OccupancyGrid
import numpy as np
import pytest
from qualities import LATCHED, RELIABLE
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from facade_manipulator.kinematics import inverse_kinematics, lci_grid, Pose
from facade_manipulator.nodes.ik_service import IkServiceNode

pytestmark = pytest.mark.quick


@pytest.fixture
def bench(ros):
    """Give an ik_service node, its joint_states and the maps it publishes."""
    class Bench:
        node = ros.add(IkServiceNode())
        tester = ros.node('tester')

        def __init__(self):
            self.states = self.tester.create_publisher(JointState, 'joint_states', RELIABLE)
            self.maps = ros.collect(
                self.tester, OccupancyGrid, 'ik_service/workspace', LATCHED)
            ros.until(lambda: self.maps and self.states.get_subscription_count(), 'the graph')

        def turn_to(self, theta):
            self.states.publish(JointState(
                name=['q1', 'q2', 'q3'],
                position=inverse_kinematics(GEOMETRY, Pose(0.0, 0.25, theta))))

    made = Bench()
    made.until = ros.until
    return made


def test_one_who_comes_late_gets_the_map_of_the_middle_angle(bench):
    grid = bench.maps[-1]
    cells, origin = lci_grid(GEOMETRY, 0.0, 0.005)
    assert (grid.info.height, grid.info.width) == cells.shape
    assert np.array_equal(np.array(grid.data), cells.ravel())
    assert grid.header.frame_id == 'rail'
    place = grid.info.origin.position
    assert (place.x, place.y) == origin[:2] and grid.info.resolution == pytest.approx(0.005)
    assert set(grid.data) >= {-1, 100}


def test_the_map_is_drawn_anew_when_the_head_has_turned(bench):
    bench.turn_to(0.2)
    bench.until(lambda: len(bench.maps) == 2, 'the map of the new angle')
    assert np.array_equal(
        np.array(bench.maps[-1].data), lci_grid(GEOMETRY, 0.2, 0.005)[0].ravel())
    bench.turn_to(0.205)  # less than THETA_STEP
    bench.node._workspace._watch()
    assert len(bench.maps) == 2


def test_its_resolution_may_be_changed_while_it_runs(bench):
    width = bench.maps[-1].info.width
    assert bench.node.set_parameters(
        [Parameter('workspace.resolution', value=0.01)])[0].successful
    bench.until(lambda: bench.maps[-1].info.width == width // 2, 'the coarser map')
