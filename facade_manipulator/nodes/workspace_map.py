"""ik_service/workspace: where the head can go at its present angle, and how well."""

from __future__ import annotations

from array import array
from collections.abc import Callable

from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node

from facade_manipulator import interfaces, ros
from facade_manipulator.kinematics import Geometry, lci_grid, Pose
from facade_manipulator.nodes.settings import WorkspaceSettings

PERIOD = 0.25  # s, between two looks at the angle
THETA_STEP = 0.01  # rad, turn of the head after which the map is drawn again


class WorkspaceMap:
    """
    Publish the conditioning over x and y at the head's angle, latched, whenever it has turned.

    Parameters
    ----------
    node : rclpy.node.Node
    geometry : Geometry
    head : callable
        Returns the head's pose in frame `rail`, None before it is known; then the map is that
        of θ = 0.

    """

    def __init__(
        self, node: Node, geometry: Geometry, head: Callable[[], Pose | None]
    ) -> None:
        self._node = node
        self._geometry = geometry
        self._head = head
        self._theta = 0.0
        self._publisher = ros.publisher(node, interfaces.WORKSPACE)
        self._settings = ros.declare(node, WorkspaceSettings, 'workspace', self._change_settings)
        ros.steady_timer(node, PERIOD, self._watch)
        self._publish()

    def _change_settings(self, settings: WorkspaceSettings) -> None:
        self._settings = settings
        self._publish()

    def _watch(self) -> None:
        head = self._head()
        if head is not None and abs(head.theta - self._theta) > THETA_STEP:
            self._theta = head.theta
            self._publish()

    def _publish(self) -> None:
        resolution = self._settings.resolution
        cells, origin = lci_grid(self._geometry, self._theta, resolution)
        grid = OccupancyGrid(data=array('b', cells.tobytes()))
        grid.header.frame_id = ros.frames(self._node).rail
        grid.header.stamp = self._node.get_clock().now().to_msg()
        grid.info.map_load_time = grid.header.stamp
        grid.info.resolution = resolution
        grid.info.height, grid.info.width = cells.shape
        grid.info.origin = ros.pose_message(origin)
        self._publisher.publish(grid)
