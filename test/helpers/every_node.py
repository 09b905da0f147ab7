"""All nodes of the machine and its simulator, in this process: what makes each, by its name."""

from __future__ import annotations

from functools import partial

from loop_bench import LoopThread

from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.disturbance_estimator import DisturbanceEstimatorNode
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.simulation.gondola_simulator import GondolaSimulatorNode

NODES = {
    'driver': partial(DriverNode, LoopThread), 'ik_service': IkServiceNode,
    'compensator': CompensatorNode, 'disturbance_estimator': DisturbanceEstimatorNode,
    'gondola_simulator': GondolaSimulatorNode}
