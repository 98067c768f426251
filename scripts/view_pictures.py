#!/usr/bin/env python3
"""Make the pictures of docs/view.md: pages of ``motion-style view`` in headless Chromium, motion by shipped models.

Needs viser, playwright (pip) and Chromium (apt); no recordings.
"""
import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml
from playwright.sync_api import sync_playwright

from style_core.formats import read_motion, write_motion
from style_core.motion import Motion

TOP = Path(__file__).resolve().parents[1]
MODELS, PERSON = TOP / 'config' / 'models', TOP / 'config' / 'skeletons' / 'person.asf'
ROBOTS = TOP / 'config' / 'robots'
COMMAND = (sys.executable, '-c', 'import sys; from style_core.cli import main; sys.exit(main())')
#: picture -> arguments of ``motion-style view``, words that the page shows once it is ready
PAGES = {
    'view_pair': (('{folder}/walk.npz', '{folder}/run.npz', '--skeleton', PERSON, '--apart', '0.9'), 'speed'),
    'view_prediction': (('{folder}/walk.npz', '--predict', MODELS / 'everyday.npz', '--skeleton', PERSON),
                        'over the whole recording'),
    'view_explorer': (('--explore', MODELS / 'locomotion_styles.npz', '--skeleton', PERSON), 'exaggerate'),
    'view_robot': (('{folder}/robot.csv', '--skeleton', ROBOTS / 'humanoid20.urdf'), 'speed'),
}


def main():
    """Make the motion, serve each page, take its picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('-o', '--output', type=Path, default=TOP / 'docs' / 'images')
    parser.add_argument('--only', choices=PAGES, nargs='+', default=list(PAGES))
    args = parser.parse_args()
    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if chromium is None:
        raise SystemExit('no Chromium: sudo apt install chromium')
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        make_motion(folder)
        browser = driver.chromium.launch(executable_path=chromium, args=[
            '--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'])
        for number, name in enumerate(args.only):
            arguments, words = PAGES[name]
            arguments = [str(word).format(folder=folder) for word in arguments]
            take(browser, arguments, words, 8300 + number, args.output / f'{name}.png')


def make_motion(folder):
    """A walk and a run of the shipped style machine, and the walk on the robot."""
    for name, style in (('walk', 'walk_07'), ('run', 'run_16')):
        run('synthesize', MODELS / 'locomotion_styles.npz', '--random-walk', '8', '--style', style,
            '-o', f'{folder}/{name}.npz')
    walk = read_motion(f'{folder}/walk.npz')
    course = dict(zip(walk.joint_names, walk.positions.T))
    joints = yaml.safe_load((ROBOTS / 'humanoid20.yaml').read_text())['joints']
    positions = [np.clip(sum((gain * course[name] for name, gain in joint.get('from', {}).items()),
                             joint.get('offset', 0.0) + np.zeros(walk.n_frames)), *joint['limits'])
                 for joint in joints.values()]
    write_motion(Motion(tuple(joints), np.transpose(positions), walk.times, name='robot'), f'{folder}/robot.csv')


def run(*words):
    subprocess.run([*COMMAND, *map(str, words)], check=True, stdout=subprocess.DEVNULL)


def take(browser, arguments, words, port, path):
    """Serve a page until its picture is taken."""
    server = subprocess.Popen([*COMMAND, 'view', *arguments, '--port', str(port)], stdout=subprocess.PIPE, text=True)
    page = browser.new_page(viewport={'width': 1280, 'height': 720})
    errors = []
    page.on('console', lambda message: errors.append(message.text) if message.type == 'error' else None)
    try:
        if not any('showing at' in line for line in server.stdout):
            raise SystemExit(f'no page for {" ".join(arguments)}')
        page.goto(f'http://127.0.0.1:{port}')
        page.get_by_text(words).first.wait_for(timeout=60_000)
        close = page.locator('.mantine-Notification-closeButton')
        page.wait_for_timeout(6_000)
        for button in close.all():      # of software rendering
            button.click()
        stand_still(page, '1.1')
        page.wait_for_timeout(5_000)
        page.screenshot(path=path)
        print(f'wrote {path}' + ''.join(f'; console: {error}' for error in errors))
    finally:
        page.close()
        server.terminate()
        server.wait(20)


def stand_still(page, seconds):
    """Stop playing, at a time of the motion."""
    for label, kind in (('play', 'checkbox'), ('time (s)', 'text')):
        control = page.get_by_text(label, exact=True).locator(
            f'xpath=ancestor::*[.//input[@type="{kind}"]][1]').locator(f'input[type={kind}]')
        if kind == 'checkbox':
            control.uncheck()
        else:
            control.fill(seconds)
            page.keyboard.press('Enter')


if __name__ == '__main__':
    main()
