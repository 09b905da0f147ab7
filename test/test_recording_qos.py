"""config/recording_qos.yaml: topics of every cycle are recorded best effort."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
import yaml

from facade_manipulator import config_path, topics

# Topics at the rate of joint_states are reliable; other reliable topics are rare or latched.
EVERY_CYCLE = (topics.CORRECTED_POSE, topics.REFERENCE, topics.JOINT_SETPOINTS,
               topics.JOINT_STATES, topics.END_EFFECTOR_POSE, topics.HEAD_POSE,
               topics.RAIL_POSE, topics.WALL_ERROR,
               topics.UNCOMPENSATED_ERROR, topics.CARRIAGE_FORCES)


def test_overrides_record_topics_of_every_cycle_best_effort():
    overrides = yaml.safe_load(config_path('recording_qos.yaml').read_text())
    assert overrides.keys() == {'/tf', *(f'/{topic.name}' for topic in EVERY_CYCLE)}
    assert all(topic.qos.reliability is not ReliabilityPolicy.BEST_EFFORT
               and topic.qos.durability is not DurabilityPolicy.TRANSIENT_LOCAL
               for topic in EVERY_CYCLE)
    for profile in overrides.values():  # rosbag2 needs the depth with the history
        assert profile == {'history': 'keep_last', 'depth': 100, 'reliability': 'best_effort'}
