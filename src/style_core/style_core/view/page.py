"""The page in the browser: bodies on a floor, a clock that plays them, the server behind; the only user of viser."""
import io
import threading
import time
from contextlib import contextmanager, redirect_stdout

import numpy as np

from style_core.errors import UsageError
from style_core.view.figure import quaternions
from style_core.view.shapes import solid

__all__ = ['Actor', 'Page', 'opened']

#: frames a second sent to the browser, and of those that also move the time slider, one in so many
FRAME_HZ, _SLIDER_EVERY = 30.0, 6
#: seconds of past that a trail shows
_TRAIL_S = 1.5
_FLOOR, _CONTACT = (208, 215, 222), (0, 114, 178)


def need_viser():
    """The module viser.

    Raises
    ------
    UsageError
        With the command that installs it, where it is not there.
    """
    try:
        import viser
    except ImportError:
        raise UsageError('the view needs viser, which is not installed: pip install viser==1.1.1') from None
    return viser


class Actor:
    """A figure in the scene.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
        Of its nodes in the scene; no other actor's.
    figure : Figure
    contacts : sequence of Contact
    trail : sequence of int
        Bodies whose past path is drawn.
    opacity : float, optional
        Of a ghost.
    meshes : sequence of Mesh
    """

    def __init__(self, scene, name, figure, contacts=(), trail=(), opacity=None, meshes=()):
        self._scene, self._name, self._opacity = scene, name, opacity
        self.figure, self._trail = figure, tuple(trail)
        self.visible, self.show_contacts, self.show_trail = True, True, bool(trail)
        self.delay_s, self._frame = 0.0, None
        # a node a part: what viser draws in batches arrives in the browser later than what is moved
        self._parts = [self._solid(part, shape) for part, shape in enumerate(figure.shapes)]
        self._meshes = [(mesh, self._wear(number, mesh)) for number, mesh in enumerate(meshes)]
        radius = 0.03 * max(float(np.nanmax(np.ptp(figure.points[0], axis=0), initial=0.0)), 1e-3)
        self._soles = [(contact, scene.add_icosphere(f'/world/{name}/contact_{contact.foot}', radius, _CONTACT,
                                                     opacity=0.5, scale=(1.6, 1.6, 0.15), visible=False))
                       for contact in contacts]
        self._path = None
        self.show(0.0)

    def _solid(self, part, shape):
        extent = np.nanmedian(self.figure.scales[:, part], axis=0)
        vertices, faces = solid(shape, np.where(np.isfinite(extent), extent, 0.0))
        return self._scene.add_mesh_simple(
            f'/world/{self._name}/{shape}_{part}', vertices, faces, opacity=self._opacity,
            color=tuple(self.figure.colours[part].tolist()), flat_shading=shape == 'box', visible=False)

    def _wear(self, number, mesh):
        import trimesh
        loaded = trimesh.load(mesh.path, force='mesh')
        return self._scene.add_mesh_simple(
            f'/world/{self._name}/mesh_{number}', np.asarray(loaded.vertices) * mesh.scale, np.asarray(loaded.faces),
            color=(150, 158, 168), opacity=self._opacity)

    def replace(self, figure, contacts=()):
        """Show another motion of the same body from now on."""
        self.figure, self._frame = figure, None
        by_foot = {contact.foot: contact for contact in contacts}
        self._soles = [(by_foot.get(contact.foot, contact), node) for contact, node in self._soles]

    def show(self, seconds):
        """Take the pose ``seconds`` after the figure's first frame."""
        figure = self.figure
        frame = figure.frame_at(seconds)
        asked = frame, self.visible, self.show_contacts, self.show_trail
        if asked == self._frame:
            return
        self._frame = asked
        places, turns = figure.positions[frame].astype(float), figure.wxyzs[frame].astype(float)
        known = np.isfinite(places).all(axis=1) & np.isfinite(turns).all(axis=1)
        for place, turn, seen, node, shape in zip(places, turns, known, self._parts, figure.shapes):
            seen = bool(seen and self.visible)
            if node.visible != seen:
                node.visible = seen
            if seen:
                node.position = place
                if shape != 'sphere':
                    node.wxyz = turn
        for mesh, node in self._meshes:
            turn = figure.rotations[frame, mesh.body]
            node.position = figure.points[frame, mesh.body] + turn @ mesh.position
            node.wxyz = quaternions(turn @ mesh.rotation)
            node.visible = self.visible
        for contact, node in self._soles:
            node.visible = bool(self.visible and self.show_contacts and contact.on_ground[frame])
            if node.visible:
                node.position = (*figure.points[frame, list(contact.bodies), :2].mean(axis=0), 0.004)
        self._draw_trail(frame)

    def _draw_trail(self, frame):
        figure = self.figure
        first = int(np.searchsorted(figure.times, figure.times[frame] - _TRAIL_S))
        stride = max((frame - first) // 45, 1)
        past = figure.points[first:frame + 1:stride, list(self._trail)] if self._trail else np.empty((0, 0, 3))
        pieces = np.stack([past[:-1], past[1:]], axis=2).reshape(-1, 2, 3)
        pieces = pieces[np.isfinite(pieces).all(axis=(1, 2))]
        shown = self.visible and self.show_trail and len(pieces)
        if self._path is not None and not shown:
            self._path.visible = False
        elif shown and self._path is None:
            self._path = self._scene.add_line_segments(f'/world/{self._name}/trail', pieces.astype(np.float32),
                                                       (140, 149, 159), thickness=2, thickness_units='screen')
        elif shown:
            self._path.visible = True
            self._path.points, self._path.colors = pieces.astype(np.float32), np.array((140, 149, 159), np.uint8)


class Page:
    """A served page with a floor, actors, a clock and its controls.

    Parameters
    ----------
    server : viser.ViserServer
    duration_s : float
    title : str

    Attributes
    ----------
    actors : list of Actor
    on_frame : list of callable
        Called with the seconds shown, some times a second.
    on_tick : list of callable
        Called with the seconds shown at every frame, before it is sent.
    lock : threading.RLock
        Held while the scene changes.
    """

    def __init__(self, server, duration_s, title=''):
        self.server, self.actors, self.on_frame, self.on_tick = server, [], [], []
        self.lock, self._over = threading.RLock(), threading.Event()
        self._seconds, self.duration_s = 0.0, max(duration_s, 1e-3)
        server.scene.set_up_direction('+z')
        self._world = server.scene.add_frame('/world', show_axes=False)
        server.scene.add_grid('/world/floor', width=60, height=60, cell_size=0.25, section_size=1.0, cell_color=_FLOOR,
                              section_color=(140, 149, 159), shadow_opacity=0.25, plane_opacity=0.4,
                              fade_distance=14.0)
        self._controls(title)

    def _controls(self, title):
        gui = self.server.gui
        gui.set_panel_label(title or 'motion-style view')
        with gui.add_folder('Time'):
            self._play = gui.add_checkbox('play', True)
            self.slider = gui.add_slider('time (s)', 0.0, round(self.duration_s, 3), 0.001, 0.0)
            self._speed = gui.add_slider('speed', 0.05, 3.0, 0.05, 1.0)
            self._loop = gui.add_checkbox('repeat', True)
        with gui.add_folder('Show'):
            self._follow = gui.add_checkbox('follow', True)
            self._contacts = gui.add_checkbox('contacts', True)
            self._trails = gui.add_checkbox('trails', True)

        @self.slider.on_update
        def _(event):
            if event.client is not None:     # moved by hand, not by the clock
                with self.lock:
                    self._seconds = float(self.slider.value)

        for box in (self._contacts, self._trails):
            box.on_update(lambda _: self._apply())

    def _apply(self):
        with self.lock:
            for actor in self.actors:
                actor.show_contacts, actor.show_trail = self._contacts.value, self._trails.value

    @property
    def seconds(self):
        """Time shown, s after the first frame."""
        return self._seconds

    def go_to(self, seconds, duration_s=None):
        """Show another time, of a motion of another length where one is given."""
        with self.lock:
            if duration_s is not None:
                self.duration_s = max(duration_s, 1e-3)
                self.slider.max = round(self.duration_s, 3)
            self._seconds = float(np.clip(seconds, 0.0, self.duration_s))

    def add(self, actor):
        """Put an actor on the floor."""
        with self.lock:
            self.actors.append(actor)
        return actor

    def look_at(self, target, distance):
        """Where the camera of a new visitor stands: to the right of ``target``, shape (3,), m."""
        self.server.initial_camera.look_at = tuple(map(float, target))
        self.server.initial_camera.position = tuple(map(float, np.add(target, (0.45 * distance, -0.85 * distance,
                                                                               0.3 * distance))))

    def tick(self, dt):
        """Go on by ``dt`` seconds and show what is there then."""
        with self.lock:
            if self._play.value:
                self._seconds += dt * self._speed.value
                if self._seconds > self.duration_s:
                    self._seconds = self._seconds % self.duration_s if self._loop.value else self.duration_s
            seconds = self._seconds
            with self.server.atomic():
                for actor in self.actors:
                    actor.show(seconds - actor.delay_s)
                for call in self.on_tick:
                    call(seconds)
                self._centre()
        return seconds

    def _centre(self):
        """Keep the first body before the camera: the world moves, so that the camera stays the visitor's own."""
        if not self.actors or not self._follow.value:
            self._world.position = (0.0, 0.0, 0.0)
            return
        figure = self.actors[0].figure
        here = figure.points[figure.frame_at(self._seconds - self.actors[0].delay_s), 0]
        if np.isfinite(here[:2]).all():
            self._world.position = (-here[0], -here[1], 0.0)

    def run(self):
        """Serve until `close`."""
        last, count = time.monotonic(), 0
        while not self._over.wait(max(last + 1 / FRAME_HZ - time.monotonic(), 0.0)):
            now = time.monotonic()
            seconds = self.tick(now - last)
            last, count = now, count + 1
            if count % _SLIDER_EVERY == 0:
                if abs(self.slider.value - seconds) > 5e-4 and self._play.value:
                    self.slider.value = round(min(seconds, self.slider.max), 3)
                for call in self.on_frame:
                    call(seconds)

    def close(self):
        """End `run`."""
        self._over.set()


@contextmanager
def opened(host, port, title):
    """A server of pages on ``host`` and ``port``, stopped at the end.

    Raises
    ------
    UsageError
        If viser is not installed or the address cannot be served.
    """
    viser = need_viser()
    need_free(host, port)
    with redirect_stdout(io.StringIO()):    # its banner
        server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
    # a page must not hand the motion to a public server: viser asks its own for a tunnel whenever a client wants one
    server.request_share_url = lambda verbose=True: None
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


def need_free(host, port):
    """viser takes another port without a word where this one is in use."""
    import socket
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        raise UsageError(f'cannot serve on {host} port {port}: {error.strerror or error} (--host, --port)') from None
