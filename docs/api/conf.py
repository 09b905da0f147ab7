"""What `make docs` makes of the docstrings: each room as its face shows it."""

from pkgutil import walk_packages

import facade_manipulator

project = 'facade_manipulator'
extensions = ['sphinx.ext.autodoc', 'sphinx.ext.napoleon']
html_theme = 'alabaster'
autodoc_default_options = {'members': True, 'imported-members': True}
napoleon_use_ivar = True
suppress_warnings = ['ref.python']  # fields of several records have one name

_NAME = facade_manipulator.__name__
_NOT_FACES = {'drives', 'nodes', 'tools', 'lab', 'lab.demo', 'lab.gondola.bench'}
_FACES = sorted(
    package.name for package in walk_packages(facade_manipulator.__path__, f'{_NAME}.')
    if package.ispkg and package.name.removeprefix(f'{_NAME}.') not in _NOT_FACES)


def _add_faces(app, document, text):
    """Append a section for each room to the only page."""
    text[0] += '\n'.join(
        f'\n{face}\n{"-" * len(face)}\n\n.. automodule:: {face}\n' for face in _FACES)


def setup(app):
    """Let Sphinx call what belongs to this page."""
    app.connect('source-read', _add_faces)
