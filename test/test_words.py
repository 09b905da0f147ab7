"""Names and messages speak the field's language; comments and docstrings may say it their way."""

from __future__ import annotations

import ast
import io
from pathlib import Path
import re
import tokenize

import pytest

import facade_manipulator

PACKAGE = Path(facade_manipulator.__file__).parent
INSTEAD = {  # the word: what the trade says
    'opinion': 'model', 'decisiveness': 'weight exponent',
    'foretell': 'predict', 'foretold': 'predicted',
    'astray': 'diverged', 'anew': 'again',
    'judge': 'evaluate', 'judged': 'evaluated',
    'nowhere': 'zero',
    'border': 'limit', 'excess': 'saturation error', 'anchor': 'initialise',
    'tell': 'publish', 'tells': 'publishes', 'told': 'published',
    'hear': 'receive', 'hears': 'receives', 'heard': 'received', 'unheard': 'not received',
    'sentence': 'message', 'refuse': 'reject', 'refused': 'rejected', 'refusal': 'rejection',
    'disobedient': 'not responding', 'doubt': 'fault', 'stray': 'unexpected',
    'survive': 'recover', 'survives': 'recovers',
    'wire': 'codec', 'mend': 'correct', 'mended': 'corrected',
}
OTHERS = re.compile('bbox_to_anchor')  # matplotlib's
ANY = re.compile('|'.join(INSTEAD), re.IGNORECASE)


def words(text: str) -> set[str]:
    """Return the words of source text, those within identifiers too, without a plural's s."""
    parts = re.findall(r'[A-Z]?[a-z]+|[A-Z]+(?![a-z])', text)
    return {part.lower() for part in parts} | {part.lower().removesuffix('s') for part in parts}


def said(source: str) -> list[tuple[int, str]]:
    """Return line and text of each identifier and string in a source, docstrings left out."""
    docstrings = {node.value.lineno for node in ast.walk(ast.parse(source))
                  if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)}
    return [(token.start[0], token.string)
            for token in tokenize.generate_tokens(io.StringIO(source).readline)
            if token.type not in (tokenize.COMMENT, tokenize.OP)
            and not (token.type == tokenize.STRING and token.start[0] in docstrings)]


def private(text: str) -> set[str]:
    return words(OTHERS.sub('', text)) & INSTEAD.keys()


def test_no_private_word_is_in_the_source():
    found = [f'{path.relative_to(PACKAGE)}:{number}: say {INSTEAD[word]}, not {word}: {text}'
             for path in sorted(PACKAGE.rglob('*.py'))
             if ANY.search(source := path.read_text()) and private(source)  # or in a comment
             for number, text in said(source) for word in private(text)]
    assert not found, '\n'.join(found)


@pytest.mark.parametrize('text', [
    'def take_anchor(self):', 'class HeardSync:', "'the drive is told'", 'LAST_REFUSALS'])
def test_a_private_word_is_found_wherever_it_stands(text):
    assert private(text)


@pytest.mark.parametrize('text', ['intellect', 'Wireless', 'recommended', 'hearts', 'strayed'])
def test_a_word_that_contains_one_is_another(text):
    assert not private(text)


def test_a_comment_and_a_docstring_are_free():
    source = '"""It is told."""\nname = \'heard\'  # anew\n'
    assert 'heard' in str(said(source)) and not {'told', 'anew'} & words(str(said(source)))
