"""The synthesizer without ROS: modes, styles and sources of one robot, asked for a window at every tick."""
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from style_core.errors import UsageError
from style_core.style_expression import evaluate_style
from style_core.synthesis.performer import Performer
from style_core.synthesis.repertoire import FollowSettings
from style_core.synthesis.sources.phase_style import FollowSource

__all__ = ['CHANGING', 'FAULT', 'FINISHED', 'IDLE', 'PLAYING', 'Stage', 'StageSettings', 'Standing', 'check_style']

IDLE, PLAYING, CHANGING, FINISHED, FAULT = range(5)
#: the style of the person who is followed, as its estimates say, in style expressions
PERSON = 'person'
_PERSON_LAG_S = 0.4


@dataclass(frozen=True)
class StageSettings:
    """How changes are made.

    Attributes
    ----------
    transition_time : float
        Of a change of style where none is given, s.
    blend_time : float
        From one source to the next, s.
    max_exaggeration : float
        A style coordinate may lie this many training ranges outside the training styles.
    lag : int
        Of style machines, frames.
    follow : FollowSettings
    """

    transition_time: float = 0.5
    blend_time: float = 0.6
    max_exaggeration: float = 2.0
    lag: int = 20
    follow: FollowSettings = field(default_factory=FollowSettings)


@dataclass(frozen=True, eq=False)
class Standing:
    """What is being performed; times in s, styles as coordinates."""

    state: int
    message: str
    style: np.ndarray
    target: np.ndarray
    phase: float
    speed: float
    elapsed: float
    remaining: float


def style_bounds(source):
    """Lowest and highest coordinates of the named styles, shape (K,) each."""
    named = np.array(list(source.styles.values()))
    return named.min(axis=0), named.max(axis=0)


def check_style(source, v, exaggeration):
    """Refuse coordinates far outside those of the training styles.

    Raises
    ------
    UsageError
        Naming the coordinate.
    """
    lower, upper = style_bounds(source)
    room = exaggeration * np.maximum(upper - lower, 1e-6)
    for k in np.flatnonzero(~((v >= lower - room) & (v <= upper + room))):
        raise UsageError(f'{source.labels[k]} = {v[k]:.3g} lies too far outside the styles learned, '
                         f'{lower[k]:.3g} to {upper[k]:.3g} (max_exaggeration {exaggeration:g})')
    return v


class Stage:
    """Perform a repertoire on a robot.

    Parameters
    ----------
    repertoire : Repertoire
    robot : Robot
    settings : StageSettings
    """

    def __init__(self, repertoire, robot, settings=None):
        self.repertoire, self.robot = repertoire, robot
        self.joint_names = robot.bind(repertoire.joint_names).joint_names
        self.settings = settings or StageSettings()
        self.performer = None
        self.mode = ''
        self.style_text = ''
        self._options = {}
        self._person = None
        self._behaviour = ''

    # --- what to perform ----------------------------------------------------------------------------------------

    def choose(self, mode, **options):
        """Go over to another mode; options as `Repertoire.source` takes them. ``sequence`` without a score waits.

        Raises
        ------
        UsageError, ModelError
            Then what is being performed goes on.
        """
        waits = mode == 'sequence' and options.get('score') is None
        if waits and mode not in self.repertoire.modes:
            self.repertoire.source(mode)        # says why not
        source = None if waits else self._make(mode, options)
        if source is not None:
            self._begin(source)
        self.mode, self._options = mode, options
        self._behaviour = options.get('behaviour', '')

    def _make(self, mode, options):
        source = self.repertoire.source(mode, lag=self.settings.lag, follow=self.settings.follow, **options)
        if self.style_text and len(source.target):
            with suppress(UsageError):      # a style of another model or behaviour: this source keeps its own
                source.set_style(self._read(source, self.style_text), 1e-3)
                source.advance(1e-3)
        return source

    def _begin(self, source):
        if self.performer is None:
            self.performer = Performer(source, self.robot)
        else:
            self.performer.exchange(source, self.settings.blend_time)

    def replace(self, repertoire):
        """Use another model from now on, in the same mode where it can serve it.

        Raises
        ------
        ModelError, UsageError
            Then the old one stays.
        """
        old = self.repertoire
        mode = self.mode if self.mode in repertoire.modes else repertoire.modes[0]
        if self.robot.bind(repertoire.joint_names).joint_names != self.joint_names:
            raise UsageError('the new model moves other joints than the old one: configure the node anew')
        self.repertoire = repertoire
        try:
            self.choose(mode, **{key: value for key, value in self._options.items() if key in ('speed', 'seed')})
        except Exception:
            self.repertoire = old
            raise

    def perform(self, source):
        """Perform a source that belongs to no mode, until `choose` or `resume`."""
        self._begin(source)

    def resume(self):
        """Go back to the mode after `perform`; a sequence is not repeated."""
        if self.mode and self.mode != 'sequence':
            self.choose(self.mode, **self._options)

    # --- style --------------------------------------------------------------------------------------------------

    @property
    def source(self):
        """What is being performed, or about to be; None where nothing is."""
        return None if self.performer is None else self.performer.coming

    def set_style(self, style, seconds=None):
        """Change the style.

        Parameters
        ----------
        style : str or array_like, shape (K,)
            Expression over the named styles (and ``person`` when following), or coordinates.
        seconds : float, optional
            The settings' transition time where left out or 0.

        Returns
        -------
        ndarray, shape (K,)

        Raises
        ------
        UsageError
            Then the style stays.
        """
        source = self.source
        if source is None or not len(source.target):
            raise UsageError('nothing with styles is being performed')
        if seconds is not None and not (np.isfinite(seconds) and 0 <= seconds <= 3600):
            raise UsageError(f'a change of style takes 0 to 3600 s, not {seconds}')
        text = style if isinstance(style, str) else ''
        v = self.style_for(source, text, () if text else style)
        source.set_style(v, seconds or self.settings.transition_time)
        self.style_text = text
        return v

    def style_for(self, source, text, values=()):
        """Coordinates for a source: ``values`` where there are some, else those of the expression ``text``.

        Raises
        ------
        UsageError
            Where they cannot be read, do not fit, or lie too far outside the styles learned.
        """
        if not len(values):
            return self._read(source, text)
        v = np.asarray(values, dtype=float)
        if v.shape != source.target.shape or not np.isfinite(v).all():
            raise UsageError(f'a style of this model is {len(source.target)} finite numbers')
        return check_style(source, v, self.settings.max_exaggeration)

    def _read(self, source, text):
        styles = dict(source.styles)
        if not len(source.target):
            raise UsageError('this motion has no styles')
        if isinstance(source, FollowSource):
            styles[PERSON] = source.target if self._person is None or len(self._person) != len(source.target) \
                else self._person
        return check_style(source, evaluate_style(text, styles, len(source.target)), self.settings.max_exaggeration)

    # --- following ----------------------------------------------------------------------------------------------

    def observe(self, phase, velocity, behaviour='', style=None, age=0.0):
        """Take an estimate of a person's phase; whether it was of use.

        An estimate of another rhythmic behaviour of the model changes to that; one that the model cannot follow
        counts as none.
        """
        source = self.source
        if self.mode != 'follow' or not isinstance(source, FollowSource):
            return False
        current = source.behaviour.name
        if behaviour and behaviour != current and not self._behaviour:
            wanted = self.repertoire.behaviours.get(behaviour)
            if wanted is None or not wanted.rhythmic:
                return False
            source = self._make('follow', {'behaviour': behaviour})
            source.estimate(phase, velocity, age)
            self._begin(source)
            return True
        source.estimate(phase, velocity, age)
        if style is not None and len(style) == len(source.target):
            with suppress(UsageError):      # an odd estimate: the last style stays
                self._person = check_style(source, np.asarray(style, dtype=float), self.settings.max_exaggeration)
                if PERSON in self.style_text:
                    source.set_style(self._read(source, self.style_text), _PERSON_LAG_S)
        return True

    # --- time ---------------------------------------------------------------------------------------------------

    def advance(self, dt):
        """Let ``dt`` seconds pass."""
        if self.performer is not None:
            self.performer.advance(dt)

    def window(self, ahead):
        """Positions and velocities of the robot's joints, or None where there is nothing to perform."""
        if self.performer is None or not self.performer.ready:
            return None
        return self.performer.window(ahead)

    @property
    def finished(self):
        """Whether what was performed has come to rest."""
        return (self.performer is not None and self.performer.ready and not self.performer.blending
                and self.performer.coming.remaining <= 0 and self.performer.limits.settled)

    def take_saturation(self):
        """Joint -> how far it stayed behind what its motor cannot do, since this was asked last, at most; rad."""
        if self.performer is None:
            return {}
        most = self.performer.limits.take_most()
        return {self.joint_names[k]: float(most[k]) for k in np.argsort(-most) if most[k] > 0}

    def standing(self):
        """A `Standing`: what to report."""
        nothing = np.zeros(0)
        if self.performer is None:
            return Standing(IDLE, 'waits for a sequence' if self.mode == 'sequence' else 'nothing chosen', nothing,
                            nothing, 0.0, 0.0, 0.0, 0.0)
        source = self.performer.source
        facts = source.style, source.target, source.phase, source.speed, self.performer.elapsed, source.remaining
        if not self.performer.ready:
            return Standing(IDLE, 'waits for estimates', *facts)
        if self.finished:
            return Standing(FINISHED, 'has come to its end', *facts)
        if isinstance(source, FollowSource) and not source.following:
            return Standing(PLAYING, 'no estimates: standing still' if source.speed < 1e-3 else
                            'no estimates: slowing down', *facts)
        changing = self.performer.blending or not np.allclose(source.style, source.target, atol=1e-9)
        return Standing(CHANGING if changing else PLAYING, '', *facts)
