"""contact_wrench from joint_states: part of the ik_service node, off where a sensor publishes."""

from __future__ import annotations

from functools import partial
import math

from rclpy.node import Node

from facade_manipulator import interfaces
from facade_manipulator.compensation.contact_estimate import contact_wrench, FrictionSettings
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose
from facade_manipulator.messages import CARRIAGES, require_finite
from facade_manipulator.motion.limits import Triple
from facade_manipulator.nodes.settings import ContactSettings
from facade_manipulator.ros.conversions import frames, wrench_stamped
from facade_manipulator.ros.interfaces import publisher
from facade_manipulator.ros.parameters import declare


class ContactView:
    """Publish the wrench of the wall on the head, from the forces of the carriages."""

    def __init__(self, node: Node, geometry: Geometry) -> None:
        self._mechanism = mechanism_of(geometry)
        self._friction = declare(
            node, FrictionSettings, 'friction', partial(setattr, self, '_friction'))
        self._frame, self._publisher = frames(node).end_effector, None
        if declare(node, ContactSettings, 'contact_wrench').from_drives:
            self._publisher = publisher(node, interfaces.CONTACT_WRENCH)

    def publish(
        self, time: float, head: Pose, velocity: Triple, effort: Triple
    ) -> None:
        """
        Publish the wrench at the time [s] of joint states.

        Parameters
        ----------
        time : float
        head : Pose
        velocity, effort : tuple of float, shape (3,)
            [m/s], [N].

        Raises
        ------
        InputError
            Velocity or effort are missing, so all NaN, or not finite.

        """
        if self._publisher is None:
            return
        for what, values in (('velocity', velocity), ('effort', effort)):
            if all(map(math.isnan, values)):
                raise InputError(
                    'names', f'joint_states has no {what} for each of {", ".join(CARRIAGES)}')
            require_finite(CARRIAGES, values, f'joint_states {what} of')
        wrench = contact_wrench(self._mechanism, self._friction, head, velocity, effort)
        self._publisher.publish(wrench_stamped(self._frame, time, wrench))
