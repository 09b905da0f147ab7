"""Topics and services of the table in `facade_manipulator.interfaces`, as rclpy wants them."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from rclpy.client import Client
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service as Offer
from rclpy.subscription import Subscription

from facade_manipulator.interfaces import Quality, Service, Topic


def profile(quality: Quality) -> QoSProfile:
    """Return a quality of service for rclpy."""
    # a reliable topic is as volatile as the middleware makes it: with VOLATILE by name Fast DDS
    # 2.14 lost a setpoint in every other run of a test of the driver on a busy computer
    durability = (DurabilityPolicy.TRANSIENT_LOCAL if quality.latched else
                  DurabilityPolicy.SYSTEM_DEFAULT if quality.reliable else
                  DurabilityPolicy.VOLATILE)
    reliability = (ReliabilityPolicy.RELIABLE if quality.reliable else
                   ReliabilityPolicy.BEST_EFFORT)
    return QoSProfile(depth=quality.depth, reliability=reliability, durability=durability)


def class_of(interface: Topic | Service) -> Any:
    """Return the class of a topic's messages, or of a service's requests and responses."""
    package, name = interface.type.split('/')
    kind = 'msg' if isinstance(interface, Topic) else 'srv'
    return getattr(import_module(f'{package}.{kind}'), name)


def is_installed(topic: Topic) -> bool:
    """Return whether this computer has the messages of a topic; only an optional one may miss."""
    try:
        class_of(topic)
    except ImportError:
        if not topic.optional:
            raise
        return False
    return True


def publisher(
    node: Node, topic: Topic, matched: Callable[[Any], None] | None = None
) -> Publisher:
    """Return what publishes on a topic; `matched` is told of who subscribes."""
    return node.create_publisher(
        class_of(topic), topic.name, profile(topic.quality),
        event_callbacks=PublisherEventCallbacks(matched=matched))


def subscription(
    node: Node, topic: Topic, callback: Callable[[Any], None], raw: bool = False, name: str = '',
    incompatible: Callable[[Any], None] | None = None,
    matched: Callable[[Any], None] | None = None,
) -> Subscription:
    """
    Subscribe to a topic, or to one of its kind with another name.

    `incompatible` is called, instead of a line in the log, when a publisher is found whose
    messages cannot be received, since its quality of service is less than the topic's. `matched`
    is called when a publisher comes or goes.
    """
    return node.create_subscription(
        class_of(topic), name or topic.name, callback, profile(topic.quality), raw=raw,
        event_callbacks=SubscriptionEventCallbacks(
            incompatible_qos=incompatible, matched=matched))


def incompatible(topic: str) -> str:
    """Return what is wrong where a publisher of a topic cannot be heard."""
    return f'{topic} has an incompatible publisher: its quality of service is not reliable'


def service(node: Node, offered: Service, callback: Callable[[Any, Any], Any]) -> Offer:
    """Offer a service."""
    return node.create_service(class_of(offered), offered.name, callback)


def client(node: Node, called: Service) -> Client:
    """Return what calls a service."""
    return node.create_client(class_of(called), called.name)
