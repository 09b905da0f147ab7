"""
The executables of the nodes: a signal that comes while their modules are still imported ends them.

Importing takes a second, and `run` handles signals only after it. Until then nothing runs that had
to be closed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
import os
import signal

ELSEWHERE = {'gondola_simulator': 'lab.demo.gondola_simulator'}  # else it is in `nodes`

def __getattr__(node: str) -> Callable[[], int]:
    """Return what starts a node, by the name of its module."""
    if node.startswith('_'):
        raise AttributeError(node)
    return partial(_start, node)


def _start(node: str) -> int:
    numbers = signal.SIGINT, signal.SIGTERM
    before = [signal.signal(number, lambda *_: os._exit(0)) for number in numbers]
    main = import_module(f'facade_manipulator.{ELSEWHERE.get(node, f"nodes.{node}")}').main
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
    return main()
