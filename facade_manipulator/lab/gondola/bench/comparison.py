"""
Predictions side by side: how they are named, as a table and as a picture.

A case is a dict: ``rms`` is what is left by prediction and axis (x, y, θ), None where it does not
count; ``within_two_deviations`` the share of the learnt prediction's errors, by axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from facade_manipulator.lab.gondola import pictures

LEARNT, BEFORE, WITHOUT_ANY = 'learnt', 'before', 'without'
PREDICTIONS = {  # as people read them, colour and mark in the picture, from worst to best
    WITHOUT_ANY: ('no compensation', pictures.WITHOUT, 's'),
    'held': ('last estimate', '#e69f00', 'v'),
    'acceleration': ('constant acceleration', '#009e73', '^'),
    BEFORE: ('before', '#cc79a7', 'D'),
    LEARNT: ('learnt with tones', pictures.WITH, 'o'),
    'bound': ('Cramér–Rao bound', '#000000', '|'),
    'oracle': ('oracle', '#d55e00', 'x'),
    'known': ('disturbance known', '#56b4e9', '+'),
}
Cells = Sequence[float | None]  # of the axes
Cases = dict[str, dict[str, Any]]
PERCENT = (100.0, 100.0, 100.0)


def put_beside(cases: Cases, earlier: Cases) -> None:
    """Put what an earlier report says of the same cases beside."""
    for name in cases.keys() & earlier.keys():
        cases[name]['rms'][BEFORE] = earlier[name]['rms'][LEARNT]


def comparison(cases: Cases, scales: Cells, in_percent: bool) -> Iterator[str]:
    """
    Yield the lines of a Markdown table whose columns stand below one another.

    Last come the share of the gap between learnt and oracle that the bound explains, and that of
    the errors within two of the deviations which the prediction gives itself.

    Scales lead to the units in which people read the axes; in percent, what is left is a share of
    what is without compensation.
    """
    shown = [name for name in PREDICTIONS if any(name in case['rms'] for case in cases.values())]
    lines = [('', *(PREDICTIONS[name][0] for name in shown), 'gap explained [%]',
              'within 2 σ [%]')]
    for name, case in cases.items():
        rms = dict(case['rms'])
        whole = rms.pop(WITHOUT_ANY)
        part = [value and 100.0 / value for value in whole] if in_percent else scales
        lines.append((
            name, figures(whole, scales), *(figures(rms.get(key), part) for key in shown[1:]),
            figures(explained(case['rms']), PERCENT),
            figures(case['within_two_deviations'], PERCENT)))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    lines.insert(1, tuple(width * '-' for width in widths))
    for line in lines:
        yield f'| {" | ".join(map(str.ljust, line, widths))} |'


def explained(rms: dict[str, Cells]) -> Cells | None:
    """Return which share of the gap between learnt and oracle the bound explains."""
    if not rms.keys() >= {LEARNT, 'bound', 'oracle'}:
        return None
    return [
        None if learnt is None or bound is None or oracle is None
        else (bound - oracle) / (learnt - oracle) for learnt, bound, oracle in zip(
            rms[LEARNT], rms['bound'], rms['oracle'], strict=True)]


def figures(values: Cells | None, scales: Cells) -> str:
    """Return the values of the axes as people read them."""
    return '' if values is None else ' / '.join(
        '–' if value is None or scale is None else f'{scale * value:#.3g}'
        if scale * value < 99.95 else f'{scale * value:.0f}'
        for value, scale in zip(values, scales, strict=True))


def draw_comparison(
    path: Path, cases: Cases, scales: Cells, titles: Sequence[str], title: str
) -> None:
    """
    Draw what every prediction leaves in every case into a PNG file.

    Scales lead to the units of the titles of the axes.
    """
    figure = pictures.new_figure(13, 2.0 + 0.35 * len(cases), title)
    panels = figure.subplots(1, len(titles), sharey=True)
    for axis, (panel, text) in enumerate(zip(panels, titles, strict=True)):
        for name, (legend, colour, mark) in PREDICTIONS.items():
            found = {row: scales[axis] * case['rms'][name][axis]
                     for row, case in enumerate(cases.values())
                     if name in case['rms'] and case['rms'][name][axis]}
            if found:
                panel.plot(found.values(), found.keys(), mark, color=colour, label=legend, ms=7,
                           mew=2.0, mfc='none' if mark in 'sv^D' else None)
        panel.set_xscale('log')
        pictures.plain_ticks(panel.xaxis)
        panel.set_yticks(range(len(cases)), cases)
        panel.set_ylim(len(cases) - 0.5, -0.5)
        pictures.label(panel, text, '')
        panel.margins(x=0.05)
    figure.legend(*panels[0].get_legend_handles_labels(), loc='outside lower center',
                  ncols=len(PREDICTIONS), fontsize=9, frameon=False)
    pictures.save(figure, path)
