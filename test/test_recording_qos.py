"""config/recording_qos.yaml: the streams of the table, recorded best effort."""

from __future__ import annotations

import yaml

from facade_manipulator import config_path, interfaces

# Streams at the rate of joint_states are reliable; other reliable topics are rare or latched.
STREAMS = {interfaces.CORRECTED_POSE, interfaces.REFERENCE, interfaces.JOINT_SETPOINTS,
           interfaces.JOINT_STATES, interfaces.END_EFFECTOR_POSE, interfaces.TF,
           interfaces.HEAD_POSE, interfaces.RAIL_POSE,
           interfaces.CARRIAGE_FORCES}


def test_overrides_record_the_reliable_streams_best_effort():
    overrides = yaml.safe_load(config_path('recording_qos.yaml').read_text())
    assert overrides.keys() == {f'/{topic.name.lstrip("/")}' for topic in STREAMS}
    assert all(topic.quality.reliable and not topic.quality.latched for topic in STREAMS)
    for profile in overrides.values():  # rosbag2 needs the depth with the history
        assert profile == {'history': 'keep_last', 'depth': 100, 'reliability': 'best_effort'}
