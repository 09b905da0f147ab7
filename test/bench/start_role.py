"""`start_role.py NODE …`: run a node of the package that says `ready` when it begins to spin."""

from __future__ import annotations

from importlib import import_module
import sys

from facade_manipulator.ros import runtime

choose = runtime.choose_executor


def choose_and_say():
    """Choose the executor, the last thing before spinning."""
    executor = choose()
    print('ready', flush=True)
    return executor


if __name__ == '__main__':
    runtime.choose_executor = choose_and_say
    raise SystemExit(import_module(f'facade_manipulator.nodes.{sys.argv[1]}').main(sys.argv))
