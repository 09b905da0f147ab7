"""
Which machine to buy for a gondola, and how well a machine will do on one.

In: a scenario's motion and strokes, masses, a force on the wall, limits of size, tables of motors
and screws. Out: what each axis must do, the machines that can and of which none other is better,
and one's parameter file. Built on the kinematics, the study's measures and the simulated gondola.
"""
