"""The page of the style explorer: sliders over the style space, named styles, content, saving."""
import threading
import time
import traceback
from html import escape

import numpy as np

from style_core.errors import ModelError, MotionError, UsageError
from style_core.view.explorer import (
    SAVED_AS,
    expression,
    file_of,
    mixed,
    of_sequence,
    of_walk,
    performed,
    reach,
    same_place,
)
from style_core.view.figure import figure_of
from style_core.view.ground import contacts_of
from style_core.view.recording import placed

__all__ = ['ExplorerPanel', 'first_body']


def first_body(machine, content, v, skeleton):
    """Motion and figure of a content in a style, on the floor."""
    motion = performed(machine, content, v)
    own = [name for name in motion.joint_names if name in set(skeleton.channel_names)]
    if not own:
        raise UsageError(f'the skeleton {skeleton.name!r} has none of the model\'s joints')
    return motion, placed(figure_of(motion.joints(own), skeleton), 'm' in motion.units)


class ExplorerPanel:
    """Controls of a style machine; what they ask for is computed in a thread of its own, the newest request only.

    Parameters
    ----------
    page : style_core.view.page.Page
    machine : StyleMachine
    skeleton : Skeleton
    content : style_core.view.explorer.Content
    actor : style_core.view.page.Actor
        The body that is restyled.
    seconds : float
        Length of random walks.
    """

    def __init__(self, page, machine, skeleton, content, actor, seconds):
        self._page, self._machine, self._skeleton = page, machine, skeleton
        self._content, self._actor, self._seconds = content, actor, seconds
        self._limits = reach(machine)
        start = machine.style('generic') if content.style is None else content.style
        self._v = np.clip(start, *self._limits)
        self._motion, _ = first_body(machine, content, self._v, skeleton)
        self._asked = threading.Event()
        self._style_controls()
        self._content_controls()
        threading.Thread(target=self._work, daemon=True).start()

    def _style_controls(self):
        gui, names = self._page.server.gui, ('generic', *self._machine.styles)
        with gui.add_folder('Style'):
            self._first = gui.add_dropdown('style', names)
            self._second = gui.add_dropdown('towards', names, initial_value=names[-1])
            self._share = gui.add_slider('share', -0.5, 1.5, 0.01, 0.0)
            self._more = gui.add_slider('exaggerate', 0.0, 2.0, 0.01, 1.0)
            self._words = gui.add_text('expression', '')
            self._sliders = [
                gui.add_slider(f'axis {number + 1}', round(float(low), 3), round(float(high), 3), 0.001,
                               round(float(np.clip(x, low, high)), 3))
                for number, (low, high, x) in enumerate(zip(*self._limits, self._v))]
            self._say = gui.add_html('')
            self._format = gui.add_dropdown('format', SAVED_AS)
            save = gui.add_button('save')
        for control in (self._first, self._second, self._share, self._more):
            control.on_update(lambda event: self._mix() if event.client is not None else None)
        self._words.on_update(lambda event: self._read() if event.client is not None else None)
        for slider in self._sliders:
            slider.on_update(lambda event: self._slide() if event.client is not None else None)
        save.on_click(self._save)
        self._tell('')

    def _content_controls(self):
        gui = self._page.server.gui
        own = self._content
        with gui.add_folder('Content', expand_by_default=False):
            seed = gui.add_number('seed', 0, min=0, max=10**6, step=1)
            walk = gui.add_button('random walk')
            text = gui.add_text('sequence', '')
            perform = gui.add_button('perform the sequence')
            back = gui.add_button('as at the start')
        walk.on_click(lambda _: self._do(lambda: of_walk(self._machine, self._seconds, int(seed.value))))
        perform.on_click(lambda _: self._do(lambda: of_sequence(self._machine, text.value)))
        back.on_click(lambda _: self._do(lambda: own))

    def _do(self, make):
        try:
            self._content = make()
        except (UsageError, ModelError) as error:
            return self._tell(str(error), wrong=True)
        self._asked.set()

    def _mix(self):
        self._take(mixed(self._machine, self._quoted(self._first.value), self._quoted(self._second.value),
                         self._share.value, self._more.value, self._limits))

    def _quoted(self, name):
        return name if name == 'generic' else f'"{name}"'

    def _read(self):
        try:
            v = self._machine.style(self._words.value)
        except UsageError as error:
            return self._tell(str(error), wrong=True)
        if (v < self._limits[0] - 1e-9).any() or (v > self._limits[1] + 1e-9).any():
            return self._tell('this style lies too far outside those learned', wrong=True)
        self._take(v)

    def _take(self, v):
        """Coordinates from elsewhere: the sliders follow."""
        self._v = v
        for slider, x in zip(self._sliders, v):
            slider.value = float(np.clip(x, slider.min, slider.max))
        self._asked.set()

    def _slide(self):
        self._v = np.clip([slider.value for slider in self._sliders], *self._limits)
        self._asked.set()

    def _work(self):
        while True:
            self._asked.wait()
            self._asked.clear()
            begun = time.perf_counter()
            content, v = self._content, self._v
            try:
                motion, figure = first_body(self._machine, content, v, self._skeleton)
                contacts = contacts_of(figure)
            except (UsageError, ModelError, MotionError, MemoryError) as error:
                self._tell(str(error), wrong=True)
                continue
            except Exception as error:      # the page stays; it must say that what it shows is not of these controls
                traceback.print_exc()
                self._tell(f'failed: {type(error).__name__}', wrong=True)
                continue
            with self._page.lock:
                self._motion = motion
                self._page.go_to(same_place(self._page.seconds, self._page.duration_s, figure.duration_s),
                                 figure.duration_s)
                self._actor.replace(figure, contacts)
            self._tell(f'restyled in {1e3 * (time.perf_counter() - begun):.0f} ms')

    def _tell(self, words, wrong=False):
        colour = '#d55e00' if wrong else '#57606a'
        self._say.content = (f'<div style="font-size:12px;padding:4px 12px;color:{colour}">{escape(words)}<br>'
                             f'<code class="style-expression">{escape(expression(self._v))}</code></div>')

    def _save(self, event):
        with self._page.lock:
            motion = self._motion
        suffix = self._format.value
        try:
            data = file_of(motion, suffix, self._skeleton)
        except (MotionError, UsageError) as error:
            return self._tell(str(error), wrong=True)
        if event.client is not None:
            event.client.send_file_download(f'restyled{suffix}', data, save_immediately=True)
