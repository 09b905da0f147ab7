"""The page in a real browser: what a person sees of machines in every condition."""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import time

from panel_bench import CAUSE, HEALTHY, NEXT, panel_bench, STOPPED
from PIL import Image
import pytest

sync_api = pytest.importorskip(
    'playwright.sync_api', reason='THE PAGE IS NOT TESTED: there is no playwright: make setup')
BROWSER = shutil.which('chromium') or shutil.which('chromium-browser')
pytestmark = [pytest.mark.realtime, pytest.mark.skipif(
    BROWSER is None, reason='THE PAGE IS NOT TESTED: there is no Chromium; apt install chromium')]
PICTURES = os.environ.get('PANEL_PICTURES')  # a folder: where docs/operation.md has them from
HOSTILE = '<img src=x onerror="document.title=\'owned\'"></script><b>' + 'w' * 500


@pytest.fixture(scope='module')
def browser():
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=BROWSER, args=['--no-sandbox', '--disable-gpu'])
        yield chromium
        chromium.close()


@pytest.fixture
def bench(tmp_path):
    with panel_bench(tmp_path) as made:
        yield made


@pytest.fixture(params=[360, 1920])
def page(request, browser, bench):
    with browser.new_context(viewport={'width': request.param, 'height': 800 if (
            request.param == 360) else 1080}) as context:
        page = context.new_page()
        page.errors = []
        page.on('pageerror', lambda error: page.errors.append(str(error)))
        page.on('console', lambda said: page.errors.append(said.text) if (
            'Content Security Policy' in said.text) else None)
        page.goto(bench.url)
        yield page
        assert page.errors == []


def until_shown(page, text, deadline=20.0):
    page.get_by_text(text).first.wait_for(timeout=1e3 * deadline)


def photograph(page, name):
    fits = page.evaluate('document.documentElement.scrollWidth <= window.innerWidth')
    assert fits, 'something is wider than the screen'
    if PICTURES:
        path = Path(PICTURES) / f'panel_{name}_{page.viewport_size["width"]}.png'
        page.screenshot(path=path)
        Image.open(path).quantize(32, dither=Image.Dither.NONE).save(path, optimize=True)


def style(page, selector, name):
    return page.eval_on_selector(selector, f'one => getComputedStyle(one)["{name}"]')


def test_a_machine_in_order_has_its_state_large_and_its_head_drawn(page):
    until_shown(page, 'gondola_1: active')
    assert float(style(page, '.state:not(#lost)', 'fontSize')[:-2]) >= 30
    assert style(page, '.state.ok', 'backgroundColor') == 'rgb(0, 114, 178)'
    page.wait_for_function(
        "document.querySelector('.residual path').getAttribute('d').length > 60", timeout=20e3)
    assert page.locator('.head').get_attribute('cx') and page.locator('.wall').is_visible()
    until_shown(page, '1864 cycles, 0 missed')
    photograph(page, 'healthy')


def test_a_stop_shows_cause_and_next_step_large_and_in_words(page, bench):
    bench.say(STOPPED)
    until_shown(page, 'gondola_1: ERROR: stopped')
    until_shown(page, f'cause: {CAUSE}')
    until_shown(page, f'next: {NEXT}')
    assert float(style(page, '.troubles li', 'fontSize')[:-2]) >= 20
    photograph(page, 'stopped')


def test_a_silent_machine_is_said_to_be_silent_within_two_seconds_and_nothing_old_stays(
        page, bench):
    until_shown(page, 'gondola_1: active')
    bench.say(None)
    began = time.monotonic()
    until_shown(page, 'gondola_1: stale: silent')
    assert time.monotonic() - began < 2.5  # bound 2 s, and what the test itself needs
    assert page.locator('.head').is_hidden() and page.locator('.wall').is_hidden()
    shown = page.locator('#gondolas').inner_text()
    assert 'active' not in shown and '1864' not in shown and '+300.00' not in shown
    photograph(page, 'silent')
    bench.say(HEALTHY)
    until_shown(page, 'gondola_1: active')


def test_a_panel_that_falls_silent_leaves_an_empty_page_that_fills_by_itself(page, bench):
    until_shown(page, 'gondola_1: active')
    bench.pause = 0.0
    until_shown(page, 'no connection to the panel')
    assert page.locator('.gondola').count() == 0
    bench.pause = 0.1
    until_shown(page, 'gondola_1: active')
    assert page.locator('#lost').is_hidden()


def test_two_gondolas_have_their_own_states(page, bench):
    bench.say(STOPPED, 'gondola_2')
    until_shown(page, 'gondola_1: active')
    until_shown(page, 'gondola_2: ERROR: stopped')
    assert page.locator('.gondola').count() == 2
    photograph(page, 'two')


def test_hostile_text_is_text(page, bench, tmp_path):
    bench.say({**HEALTHY, HOSTILE: ('error', HOSTILE, {}), 'driver: operation': (
        'error', HOSTILE, {'state': HOSTILE, 'cause': HOSTILE})})
    bench.doctor = [(HOSTILE, HOSTILE)]
    (tmp_path / 'blackbox_<b>.mcap').write_text('')
    until_shown(page, 'cause: <img src=x')
    assert page.title() == 'Façade manipulator'
    assert page.locator('img, b').count() == 0
    photograph(page, 'hostile')


def test_a_file_of_the_black_box_is_a_tap_away(page, tmp_path):
    (tmp_path / 'blackbox_000007_g_20261123T070000Z.mcap').write_bytes(b'recorded')
    page.get_by_text('black box: 1 newest').click(timeout=20e3)
    with page.expect_download() as download:
        page.locator('#files a').click()
    assert Path(download.value.path()).read_bytes() == b'recorded'


def test_the_keyboard_opens_what_doctor_says(page):
    page.get_by_text('1 wrong').focus(timeout=20e3)
    page.keyboard.press('Enter')
    page.get_by_text('WRONG clock: it is not synchronised').wait_for(timeout=5e3)


@pytest.mark.parametrize('page', [1920], indirect=True)
def test_a_screen_reader_says_cause_and_next_step_when_they_come_and_names_the_pictures(
    page, bench
):
    bench.say(STOPPED)
    until_shown(page, CAUSE)
    tree = page.context.new_cdp_session(page).send('Accessibility.getFullAXTree')['nodes']
    nodes = {node['nodeId']: node for node in tree if not node['ignored']}
    every = {node['nodeId']: node for node in tree}

    def text(node):
        return node.get('name', {}).get('value', '') + ' '.join(
            text(every[child]) for child in node.get('childIds', ()))

    def of_role(role):
        return [node for node in nodes.values() if node['role']['value'] == role]

    said, = of_role('status')
    assert {'live': 'polite'}.items() <= {
        one['name']: one['value'].get('value') for one in said['properties']}.items()
    assert CAUSE in text(said) and NEXT in text(said) and not of_role('alert')
    assert [one['name']['value'] for one in of_role('image')] == [
        'mechanism and head, seen from above, wall on top', 'distance of the last minute',
        'forces of the last minute']
