"""The pages in a real browser, where viser, playwright and Chromium are there: what the controls do is seen in it."""
import contextlib
import os
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

# not skipped on import: where launch_testing collects, that would skip every file of the folder
try:
    import viser
    from playwright import sync_api as playwright
except ImportError:
    viser = playwright = None

CONFIG = Path(__file__).parents[3] / 'config'
CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which('google-chrome')
PERSON, MACHINE = CONFIG / 'skeletons' / 'person.asf', CONFIG / 'models' / 'locomotion_styles.npz'
pytestmark = pytest.mark.skipif(None in (viser, CHROMIUM) or not MACHINE.is_file(),
                                reason='needs viser, playwright, Chromium and the config folder of the repository')
PATIENCE_MS = 60_000
#: the command, whichever way this Python finds the package
COMMAND = (sys.executable, '-c', 'import sys; from style_core.cli import main; sys.exit(main())')


@pytest.fixture(scope='module')
def browser():
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=[
            '--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'])
        yield chromium
        chromium.close()


@pytest.fixture(scope='module')
def walk(tmp_path_factory):
    path = tmp_path_factory.mktemp('view') / 'walk.npz'
    subprocess.run([*COMMAND, 'synthesize', MACHINE, '--random-walk', '3', '--style', 'walk_07', '-o', path],
                   check=True, stdout=subprocess.DEVNULL)
    return path


@contextlib.contextmanager
def page_of(browser, *arguments):
    """A page of ``motion-style view``, and what its console said; the server ends with it."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    server = subprocess.Popen([*COMMAND, 'view', *map(str, arguments), '--skeleton', str(PERSON), '--port', str(port)],
                              stdout=subprocess.PIPE, text=True, env={**os.environ, 'PYTHONUNBUFFERED': '1'})
    page = browser.new_page(viewport={'width': 640, 'height': 480})
    said = []
    page.on('console', lambda message: said.append(message.text) if message.type == 'error' else None)
    page.on('pageerror', lambda error: said.append(str(error)))
    try:
        assert any('showing at' in line for line in server.stdout)
        page.goto(f'http://127.0.0.1:{port}')
        page.get_by_text('speed', exact=True).wait_for(timeout=PATIENCE_MS)
        yield page, said
    finally:
        page.close()
        server.terminate()
        server.wait(20)


def value_of(page, label):
    """The number beside a slider."""
    return float(row(page, label).locator('input[type=text]').input_value())


def row(page, label):
    return page.get_by_text(label, exact=True).locator('xpath=ancestor::*[.//input[@type="text"]][1]')


def until(page, condition):
    """Wait until something holds in the page."""
    for _ in range(PATIENCE_MS // 100):
        if condition():
            return
        page.wait_for_timeout(100)
    raise AssertionError('it never came to hold')


def picture(page):
    return page.locator('canvas').first.screenshot()


def test_a_recording_plays_and_stops(browser, walk):
    with page_of(browser, walk) as (page, said):
        first = value_of(page, 'time (s)')
        until(page, lambda: value_of(page, 'time (s)') != first)
        page.get_by_text('play', exact=True).locator('xpath=ancestor::*[.//input[@type="checkbox"]][1]').locator(
            'input').uncheck()
        page.wait_for_timeout(1000)
        stopped = value_of(page, 'time (s)')
        page.wait_for_timeout(1500)
        assert value_of(page, 'time (s)') == stopped
        before = picture(page)
        row(page, 'time (s)').locator('input[type=text]').fill('1.2' if stopped < 1 else '0.2')
        page.keyboard.press('Enter')
        until(page, lambda: picture(page) != before)
        assert not said


def test_a_style_slider_restyles_the_body(browser):
    with page_of(browser, '--explore', MACHINE, '--seconds', '3') as (page, said):
        expression = page.locator('.style-expression')
        assert expression.inner_text().startswith('[0, 0,')
        row(page, 'axis 1').locator('input[type=text]').fill('2.5')
        page.keyboard.press('Enter')
        until(page, lambda: expression.inner_text().startswith('[2.5, 0,'))
        until(page, lambda: re.search(r'restyled in \d+ ms', expression.locator('..').inner_text()))
        assert not said


def test_a_prediction_is_laid_over_a_recording(browser, walk):
    with page_of(browser, walk, '--predict', CONFIG / 'models' / 'everyday.npz') as (page, said):
        page.get_by_text(re.compile(r'over the whole recording: error \d')).wait_for(timeout=PATIENCE_MS)
        page.get_by_text('tracking').wait_for(timeout=PATIENCE_MS)
        whole = page.get_by_text('over the whole recording').inner_text()
        row(page, 'ahead (ms)').locator('input[type=text]').fill('600')
        page.keyboard.press('Enter')
        until(page, lambda: page.get_by_text('600 ms ahead').count() and
              page.get_by_text('over the whole recording').count() and
              page.get_by_text('over the whole recording').inner_text() != whole)
        assert not said
