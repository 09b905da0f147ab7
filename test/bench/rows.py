"""Rows of the bench: contenders measured in turns, their ratio and its goal."""

from statistics import median

# from seconds, shares, bytes
FACTORS = {
    'us': 1e6,
    '%': 100.0,
    'MiB': 2.0**-20,
    'sigma': 1.0,
}


def row(name, unit, goal, ours, competitor):
    """
    Return the row of two figures in seconds, shares of a core, bytes or standard deviations.

    The ratio is ours to the competitor's where the goal is an upper bound (``<= 1.2``), and the
    competitor's to ours where it is a lower bound (``>= 40``).
    """
    sign, bound = goal.split()
    ratio = float(ours / competitor if sign == '<=' else competitor / ours)
    ours, competitor = (float(FACTORS[unit] * figure) for figure in (ours, competitor))
    is_met = ratio <= float(bound) if sign == '<=' else ratio >= float(bound)
    return {
        'name': name,
        'ours': ours,
        'competitor': competitor,
        'unit': unit,
        'ratio': ratio,
        'goal': goal,
        'met': is_met,
    }


def in_turns(contenders, rounds):
    """
    Call all contenders in each round, in rotating order.

    The result is the medians of each contender's figures. A disturbance of the machine affects all
    contenders alike, and the median drops a single disturbance.
    """
    found = [[] for _ in contenders]
    for number in range(rounds):
        for turn in range(len(contenders)):
            index = (number + turn) % len(contenders)
            found[index].append(contenders[index](number))
    return [tuple(map(median, zip(*results, strict=True))) for results in found]
