"""What `make docs` makes a site of: README, the pages of docs/, each room as its face shows it."""

from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
import re

import facade_manipulator

project = 'facade_manipulator'
extensions = [
    'sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'sphinx.ext.viewcode', 'myst_parser']
html_theme = 'alabaster'
html_theme_options = {'page_width': '70em', 'fixed_sidebar': True}
autodoc_default_options = {'members': True, 'imported-members': True}
napoleon_use_ivar = True
myst_heading_anchors = 3
suppress_warnings = ['ref.python']  # fields of several records have one name

_NAME = facade_manipulator.__name__
_NOT_FACES = {'drives', 'nodes', 'tools', 'lab', 'lab.demo', 'lab.gondola.bench'}
_FACES = sorted(
    package.name for package in walk_packages(facade_manipulator.__path__, f'{_NAME}.')
    if package.ispkg and package.name.removeprefix(f'{_NAME}.') not in _NOT_FACES)
_TOP = Path(__file__).parents[2]


def _complete(app, document, text):
    """Make the first page of README, its links as seen from docs/, and a section of each room."""
    if document == 'index':
        text[0] = re.sub(r'\]\((?!https?:)', '](../', (_TOP / 'README.md').read_text()).replace(
            '](../docs/', '](')
        first = dict.fromkeys(re.findall(r'\]\((\w+)\.md', text[0]))  # in README's own order
        rest = (path.stem for path in sorted((_TOP / 'docs').glob('*.md')))
        text[0] += '\n'.join(['', '```{toctree}', ':hidden:', *first | dict.fromkeys(
            name for name in rest if name != 'index'), 'api/index', '```', ''])
    if document == 'api/index':
        text[0] += '\n'.join(map(_section, _FACES))
    # A file to look at, not a page: its suffix is that of one.
    text[0] = text[0].replace('](../CHANGELOG.rst)', '](path:../CHANGELOG.rst)')


def _section(face):
    """Return what autodoc reads of a room; what it hands on from another stands there."""
    foreign = [name for name, one in vars(import_module(face)).items()
               if _NAME in (module := getattr(one, '__module__', None) or '')
               and not module.startswith(face)]
    return (f'\n{face}\n{"-" * len(face)}\n\n.. automodule:: {face}\n'
            f'   :exclude-members: {", ".join(foreign)}\n')


def setup(app):
    """Let Sphinx call what belongs to these pages."""
    app.connect('source-read', _complete)
