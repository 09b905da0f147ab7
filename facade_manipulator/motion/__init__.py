"""
Motion within limits: converts poses to setpoints and carriage targets.

The compensator and ik_service use `ReferencePath`, the jerk-limited path of the head. Ik_service
also uses `SetpointStream`, which certifies poses and returns setpoints. The driver uses
`SetpointFollower`, which limits speed, acceleration and jerk of the targets.
"""
