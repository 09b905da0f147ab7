"""Constants of topics and services are unique; the reference page lists each of them."""

from __future__ import annotations

from pathlib import Path
import re

import pytest

import facade_manipulator
from facade_manipulator import topics
from facade_manipulator.topics import Service, Topic

PAGE = Path(facade_manipulator.__file__).parents[1] / 'docs/reference.md'
CONSTANTS = [one for one in vars(topics).values() if isinstance(one, (Topic, Service))]


def test_each_name_is_defined_once():
    for kind in (Topic, Service):
        names = [one.name for one in CONSTANTS if isinstance(one, kind)]
        assert len(names) == len(set(names)) >= 10


@pytest.mark.skipif(not PAGE.is_file(), reason='the source tree has the pages')
def test_reference_page_lists_each_name_with_its_type():
    rows = re.findall(r'^\| `([^`]+)` \| (\w+)/(\w+) \|', PAGE.read_text(), re.MULTILINE)
    for one in CONSTANTS:
        package = one.type.__module__.partition('.')[0]
        assert (one.name, package, one.type.__name__) in rows
