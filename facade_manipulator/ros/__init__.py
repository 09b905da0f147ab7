"""
What the nodes share of ROS: messages to core values and back, parameters, life cycle, diagnostics.

Everything that rclpy offers beyond its public interface is used in this package alone.
"""
