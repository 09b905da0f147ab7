"""
One contender: `worker.py MODULE NAME quick|full`; a line on stdin is the word to run a round.

A maker, MAKERS[NAME], returns the function to time, how many items one call does, and some
numbers of its answer that are compared with the other contenders'. Without a number of items the
function measures by itself, from 'quick' or 'full' to seconds per item.
"""

from __future__ import annotations

from importlib import import_module
import json
import os
import sys
import time

ROUND = {'quick': 0.02, 'full': 0.15}  # s


def main() -> None:
    """Serve rounds until stdin ends."""
    module, name, speed = sys.argv[1:]
    try:
        run, items, answer = import_module(module).MAKERS[name]()
    except ImportError as error:
        say(missing=str(error))
        return
    say(answer=[float(value) for value in answer])
    if items is None:
        serve(lambda: run(speed))
        return
    calls = 1
    while (once := seconds(run, calls)) < 0.5 * ROUND[speed]:
        calls = max(2 * calls, round(0.8 * calls * ROUND[speed] / max(1e-9, once)))
    serve(lambda: seconds(run, calls) / calls / items)


def serve(measure) -> None:
    """Answer each line with the seconds of an item."""
    for _ in sys.stdin:
        say(seconds=measure())


def seconds(run, calls: int) -> float:
    """Return how much of the processor some calls take: who else wants it, does not count."""
    begin = time.process_time()
    for _ in range(calls):
        run()
    return time.process_time() - begin


def say(**content) -> None:
    """Tell the parent."""
    print(json.dumps(content), flush=True)


if __name__ == '__main__':
    main()
    os._exit(0)  # threads that still use a bus must not delay the end, nor complain of it
