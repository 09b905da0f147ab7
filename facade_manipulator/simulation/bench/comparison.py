"""
Predictions side by side: how they are named, as a table and as a picture.

What is left is given by case, prediction and axis (x, y, θ), None where it does not count.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from facade_manipulator.simulation.pictures import (
    label,
    plain_ticks,
    save,
    WITH,
    WITHOUT,
)

LEARNT, BEFORE, WITHOUT_ANY = 'learnt', 'before', 'without'
PREDICTIONS = {  # as people read them, colour and mark in the picture, from worst to best
    WITHOUT_ANY: ('no compensation', WITHOUT, 's'),
    'held': ('last estimate', '#e69f00', 'v'),
    'acceleration': ('constant acceleration', '#009e73', '^'),
    BEFORE: ('before', '#cc79a7', 'D'),
    LEARNT: ('learnt continuation', WITH, 'o'),
    'bound': ('Cramér–Rao bound', '#000000', '|'),
    'oracle': ('oracle', '#d55e00', 'x'),
    'known': ('disturbance known', '#56b4e9', '+'),
}
Cells = Sequence[float | None]  # of the axes


def rows(header: Sequence[str], lines: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a Markdown table whose columns stand below one another."""
    lines = [header, *lines]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    lines.insert(1, [width * '-' for width in widths])
    for line in lines:
        yield f'| {" | ".join(map(str.ljust, line, widths))} |'


def figures(values: Cells | None, scales: Cells = (1.0, 1.0, 1.0)) -> str:
    """Return the values of the axes as people read them."""
    return '' if values is None else ' / '.join(
        '–' if value is None else _figure(scale * value)
        for value, scale in zip(values, scales, strict=True))


def _figure(value: float) -> str:
    return f'{value:#.3g}' if value < 100.0 else f'{value:.0f}'


def draw_comparison(
    path: Path, cases: dict[str, dict[str, Cells]], titles: Sequence[str], title: str
) -> None:
    """
    Draw what every prediction leaves in every case.

    Parameters
    ----------
    path : pathlib.Path
        PNG file to write.
    cases : dict
        By name and prediction, in the units of the titles.
    titles : sequence of str
        Of the three axes, units included.
    title : str

    """
    figure = Figure(figsize=(13, 2.0 + 0.35 * len(cases)), layout='constrained')
    panels = figure.subplots(1, len(titles), sharey=True)
    for axis, (panel, text) in enumerate(zip(panels, titles, strict=True)):
        for name, (legend, colour, mark) in PREDICTIONS.items():
            found = {row: cells[name][axis] for row, cells in enumerate(cases.values())
                     if cells.get(name, (None,) * 3)[axis]}
            if found:
                panel.plot(found.values(), found.keys(), mark, color=colour, label=legend, ms=7,
                           mew=2.0, mfc='none' if mark in 'sv^D' else None)
        panel.set_xscale('log')
        plain_ticks(panel.xaxis)
        panel.set_yticks(range(len(cases)), cases)
        panel.set_ylim(len(cases) - 0.5, -0.5)
        label(panel, text, '')
        panel.margins(x=0.05)
    figure.legend(*panels[0].get_legend_handles_labels(), loc='outside lower center',
                  ncols=len(PREDICTIONS), fontsize=9, frameon=False)
    figure.suptitle(title)
    save(figure, path)
