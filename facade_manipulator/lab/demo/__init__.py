"""
What `make demo` runs: the real nodes as processes, simulated drives, a gondola that sways.

It leaves figures, pictures and an animation in a folder.
"""
