"""The page of predictions: recording, ghost, band, phase clock, and sensors that can be switched off."""
import threading
import traceback

import numpy as np

from style_core.view.clock_face import clock_face
from style_core.view.figure import figure_of
from style_core.view.overlay import beforehand, ghost_motion, sensors_of, spread
from style_core.view.page import Actor

__all__ = ['PredictionPanel']

#: colour of what was predicted; how many standard deviations the band shows
_GHOST, _BAND = (213, 94, 0), 2.0


class PredictionPanel:
    """Follows a recording anew, in a thread of its own, whenever a sensor or the horizon changes.

    Parameters
    ----------
    page : style_core.view.page.Page
    found : style_core.predictor_file.FilePredictor
    motion : Motion
        The predictor's joints of the recording, in its order.
    recording : Motion
        All of it that the skeleton has.
    skeleton : Skeleton
    offset : ndarray, shape (T, 3)
        What moved the recorded body to its place on the floor.
    ahead_s : float
    """

    def __init__(self, page, found, motion, recording, skeleton, offset, ahead_s):
        self._page, self._predictor, self._motion = page, found.predictor, motion
        self._recording, self._skeleton, self._offset = recording, skeleton, offset
        self._rhythmic = found.rhythmic
        self._use = np.ones(motion.positions.shape, dtype=bool)
        self._overlay = self._ghost = None
        self._band = {}     # body -> sphere
        self._wanted, self._asked, self._over = 0, threading.Event(), False
        self._build(ahead_s)
        self.refresh()
        threading.Thread(target=self._work, daemon=True).start()
        page.on_frame.append(self._show)
        page.on_tick.append(self._draw_band)

    def _build(self, ahead_s):
        gui = self._page.server.gui
        with gui.add_folder('Prediction'):
            self._ahead = gui.add_slider('ahead (ms)', 0, 1000, 10, round(1000 * ahead_s))
            self._ghost_box = gui.add_checkbox('predicted body', True)
            self._band_box = gui.add_checkbox('band (2 std)', True)
            self._panel = gui.add_html('')
            self._say = gui.add_markdown('following ...')
        with gui.add_folder('Sensors (off from the time shown on)', expand_by_default=False):
            self._sensors = {name: gui.add_checkbox(name, True) for name in sensors_of(self._motion.joint_names)}
            restore = gui.add_button('all on, from the start')
        for name, box in self._sensors.items():
            box.on_update(lambda event, name=name: self._switch(name) if event.client is not None else None)
        restore.on_click(lambda _: self._restore())
        self._ahead.on_update(lambda _: self.refresh())

    def _switch(self, name):
        frame = np.searchsorted(self._motion.times, self._motion.times[0] + self._page.seconds)
        use = self._use.copy()
        use[frame:, sensors_of(self._motion.joint_names)[name]] = self._sensors[name].value
        self._use = use
        self.refresh()

    def _restore(self):
        self._use = np.ones_like(self._use)
        for box in self._sensors.values():
            box.value = True
        self.refresh()

    def refresh(self):
        """Follow the recording once more with what the controls say."""
        self._wanted += 1
        self._asked.set()

    def _work(self):
        while not self._over:
            self._asked.wait()
            self._asked.clear()
            number, ahead = self._wanted, self._ahead.value / 1000.0
            self._say.content = 'following ...'
            try:
                overlay = beforehand(self._predictor, self._motion, ahead, self._use,
                                     lambda number=number: number != self._wanted)
                if overlay is not None:
                    self._take(overlay)
            except Exception as error:      # the page stays; it must say that what it shows is not of these controls
                traceback.print_exc()
                self._say.content = f'**failed**: {type(error).__name__}'

    def _take(self, overlay):
        ghost, std = ghost_motion(overlay, self._recording)
        figure = figure_of(ghost, self._skeleton, _GHOST)
        near = np.searchsorted(self._recording.times, ghost.times - 1e-9).clip(0, len(self._offset) - 1)
        figure = figure.moved(self._offset[near])
        radius = _BAND * spread(self._skeleton, ghost, std)
        with self._page.lock:
            self._overlay, self._figure, self._radius = overlay, figure, radius
            if self._ghost is None:
                self._ghost = self._page.add(Actor(self._page.server.scene, 'predicted', figure, opacity=0.55))
            else:
                self._ghost.replace(figure)
            for body in set(np.flatnonzero((radius > 0).any(axis=0)).tolist()) - set(self._band):
                self._band[body] = self._page.server.scene.add_icosphere(
                    f'/world/band_{body}', 1.0, _GHOST, opacity=0.15, cast_shadow=False, visible=False)
            self._ghost.delay_s = float(figure.times[0] - self._recording.times[0])
        rms = np.sqrt(np.nanmean(overlay.errors()**2)) if np.isfinite(overlay.errors()).any() else np.nan
        dark = sum(not box.value for box in self._sensors.values())
        self._say.content = (f'over the whole recording: error {np.degrees(rms):.2f}° (root mean square)'
                             + (f', {dark} sensors off' if dark else ''))

    def _show(self, seconds):
        with self._page.lock:
            if self._overlay is None:
                return
            overlay = self._overlay
            made = self._motion.times[0] + seconds - overlay.ahead_s
            frame = int(np.clip(np.searchsorted(overlay.times, made + 1e-9, side='right') - 1, 0,
                                len(overlay.times) - 1))
            self._ghost.visible = bool(self._ghost_box.value)
        behaviours = overlay.behaviours[frame]
        likely = max(behaviours, key=behaviours.get) if behaviours else next(iter(self._rhythmic), None)
        self._panel.content = clock_face(overlay, frame, self._rhythmic.get(likely, True))

    def _draw_band(self, seconds):
        if self._overlay is None:
            return
        frame = self._figure.frame_at(seconds - self._ghost.delay_s)
        shown = self._band_box.value
        for body, node in self._band.items():
            radius, place = self._radius[frame, body], self._figure.points[frame, body]
            node.visible = bool(shown and np.isfinite(place).all() and radius > 0)
            if node.visible:
                node.position, node.scale = place, max(float(radius), 1e-4)
