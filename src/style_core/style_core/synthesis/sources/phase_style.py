"""Phase-style models as a source of motion: a cycle at a commanded cadence, and following a person's phase."""
import numpy as np

from style_core.budgets import LARGEST_PHASE
from style_core.errors import ModelError, UsageError
from style_core.phase_style.basis_table import NODES, tabulate
from style_core.synthesis.glide import Glide
from style_core.synthesis.sources.source import TimedSource

__all__ = ['CycleSource', 'FollowSource', 'StyleCycle']

TURN = 2 * np.pi


class StyleCycle:
    """One behaviour of a phase-style model as a function of phase and style, eq. (2) of Matsubara et al. 2012:
    the pose is the sum of the observation bases at a phase, weighted by the style.

    Parameters
    ----------
    behaviour : style_core.phase_style.Behaviour
    """

    def __init__(self, behaviour):
        self.behaviour = behaviour
        self._table = tabulate(behaviour.processes(), behaviour.rhythmic)
        self._weighted = None
        self.span = TURN if behaviour.rhythmic else 1.0
        self.styles = _named_styles(behaviour)
        self.labels = tuple(f'style {k + 1}' for k in range(behaviour.style_dimension))
        self.mean_style = behaviour.styles.mean(axis=0)

    def bases(self, phase):
        """Bases and their derivatives by phase at the phases (K,): two arrays (K, J, D)."""
        return self._evaluate(self._table.values, self._table.slopes, phase)

    def pose(self, phase, style):
        """Poses and their derivatives by phase, (K, D) each, in one style (J,).

        The bases are weighted once a style, not once a call.
        """
        if self._weighted is None or not np.array_equal(self._weighted[0], style):
            self._weighted = np.array(style), *(np.tensordot(part, style, axes=(1, 0))
                                                for part in (self._table.values, self._table.slopes))
        return self._evaluate(*self._weighted[1:], phase)

    def _evaluate(self, values, slopes, phase):
        """Hermite interpolation of a table, (NODES + 1, ...) each, and its derivative by phase."""
        if self.behaviour.rhythmic:
            phase = np.mod(phase, TURN)
        node = np.clip(phase / self.span, 0.0, 1.0) * NODES
        k = np.minimum(node.astype(int), NODES - 1)
        u = (node - k).reshape(-1, *(1,) * (values.ndim - 1))
        p0, p1, m0, m1 = values[k], values[k + 1], slopes[k], slopes[k + 1]
        bend, rise = 2 * (p0 - p1) + m0 + m1, 3 * (p1 - p0) - 2 * m0 - m1
        return p0 + u * (m0 + u * (rise + u * bend)), (m0 + u * (2 * rise + 3 * u * bend)) * (NODES / self.span)


def _named_styles(behaviour):
    """The training sequences, and the mean of each person with several."""
    names = list(behaviour.sequences)
    styles = dict(zip(names, behaviour.styles))
    for group in dict.fromkeys(behaviour.groups):
        own = [k for k, name in enumerate(behaviour.groups) if name == group]
        if group not in styles and len(own) > 1:
            styles[group] = behaviour.styles[own].mean(axis=0)
    styles['mean'] = behaviour.styles.mean(axis=0)
    return styles


class _Styled(TimedSource):
    """What cycle and follow share: a style on its way, and poses of phases."""

    def __init__(self, behaviour, style, speed, space):
        super().__init__(speed)
        self._space = None if space is None else space.select(behaviour.joint_names)
        self._near = None
        self._cycle = StyleCycle(behaviour)
        self.joint_names = behaviour.joint_names
        self.styles, self.labels = self._cycle.styles, self._cycle.labels
        self._style = Glide(self._cycle.mean_style if style is None else self._checked(style))

    @property
    def behaviour(self):
        """What is performed."""
        return self._cycle.behaviour

    def _checked(self, v):
        v = np.asarray(v, dtype=float)
        if v.shape != (len(self.labels),) or not np.isfinite(v).all():
            raise UsageError(f'a style of this model is {len(self.labels)} finite numbers')
        return v

    @property
    def style(self):
        """See `MotionSource.style`."""
        return self._style.at()

    @property
    def target(self):
        """See `MotionSource.target`."""
        return self._style.target

    def set_style(self, v, seconds):
        """See `MotionSource.set_style`."""
        self._style.go(self._checked(v), seconds)

    def advance(self, dt):
        """See `MotionSource.advance`."""
        super().advance(dt)
        self._style.advance(dt)

    def _pose(self, ahead, phase):
        """Positions and their derivatives by phase and by the changing style, (K, D) each."""
        if not self._style.moving:
            here, slope = self._cycle.pose(phase, self._style.target)
            by_style = np.zeros_like(here)
        else:
            bases, slopes = self._cycle.bases(phase)
            v, rate = self._style.at(ahead), self._style.rate(ahead)
            here, slope = np.einsum('kj,kjd->kd', v, bases), np.einsum('kj,kjd->kd', v, slopes)
            by_style = np.einsum('kj,kjd->kd', rate, bases)
        if self._space is None:
            return here, slope, by_style
        _, by_style = self._space.decode(here, self._near, velocity=by_style)
        here, slope = self._space.decode(here, self._near, velocity=slope)
        if len(here):
            self._near = here[0].copy()
        return here, slope, by_style


class CycleSource(_Styled):
    """A behaviour performed by itself: a cycle for ever, or a discrete motion from start to goal.

    Parameters
    ----------
    behaviour : Behaviour
    style : array_like, shape (J,), optional
        The mean style where left out.
    speed : float
        1 moves at the mean phase velocity of the training sequences.
    phase : float
        To start from; rad, or [0, 1].
    space : JointSpace, optional
        In which the behaviour was learned.
    """

    def __init__(self, behaviour, style=None, speed=1.0, phase=0.0, space=None):
        super().__init__(behaviour, style, speed, space)
        self._start = float(phase)
        self._velocity = float(behaviour.velocity[0])
        if not self._velocity > 0:
            raise ModelError(f'{behaviour.name}: the mean phase velocity is {self._velocity}, not positive')

    @property
    def period(self):
        """Of one cycle at this speed, s; infinite while standing still."""
        return self._cycle.span / self.cadence if self.cadence > 0 else np.inf

    @property
    def cadence(self):
        """Phase velocity now; rad/s, or 1/s."""
        return self._velocity * self.speed

    @property
    def phase(self):
        """See `MotionSource.phase`."""
        phase = self._start + self._velocity * self._content
        return float(phase % TURN) if self._cycle.behaviour.rhythmic else float(min(phase, 1.0))

    @property
    def remaining(self):
        """See `MotionSource.remaining`."""
        if self._cycle.behaviour.rhythmic:
            return np.inf
        if self.speed <= 0:
            return 0.0 if self.phase >= 1.0 else np.inf
        return (1.0 - self.phase) / self.cadence

    def _course(self, ahead, content):
        phase = self._start + self._velocity * content
        positions, by_phase, by_time = self._pose(ahead, phase)
        velocity = np.full(len(ahead), self._velocity)
        if not self._cycle.behaviour.rhythmic:
            velocity[phase >= 1.0] = 0.0
        return positions, by_phase * velocity[:, None], by_time


class FollowSource(_Styled):
    """A rhythmic behaviour at the phase of a person, in another style.

    The phase is pulled towards the estimated one like a critically damped spring, so that it and its velocity are
    continuous whatever the estimates do. Without estimates it coasts at its last speed for ``coast`` and then
    slows down to a stop within ``stop``; when they come again it takes up speed likewise.

    Parameters
    ----------
    behaviour : Behaviour
        Rhythmic.
    style : array_like, shape (J,), optional
    stiffness : float
        Natural frequency of the pull, rad/s.
    patience, coast, stop : float
        Estimates are missing after ``patience``; s.
    space : JointSpace, optional
        In which the behaviour was learned.
    """

    def __init__(self, behaviour, style=None, stiffness=6.0, patience=0.1, coast=0.5, stop=1.0, space=None):
        if not behaviour.rhythmic:
            raise UsageError(f'{behaviour.name} runs from a start to a goal: only rhythmic behaviours can be followed')
        super().__init__(behaviour, style, 0.0, space)
        self._stiffness, self._coast, self._stop = stiffness, patience + coast, stop
        self._lowest, self._highest = 0.0, float(behaviour.velocity[3])
        self._goal, self._velocity = 0.0, 0.0   # estimated phase now, and its velocity
        self._gap, self._closing = 0.0, 0.0     # own phase minus the estimated, and its rate
        self._silent = np.inf
        self.ready = False

    @property
    def following(self):
        """Whether estimates come."""
        return self._silent <= self._coast

    @property
    def phase(self):
        """See `MotionSource.phase`."""
        return float((self._goal + self._gap) % TURN)

    def estimate(self, phase, velocity, age=0.0):
        """Take an estimate.

        Parameters
        ----------
        phase : float
            Rad.
        velocity : float
            Rad/s; kept between standing still and the highest the model allows.
        age : float
            Of the observation it follows from, s.

        Raises
        ------
        UsageError
            If a number is not finite, or larger than `style_core.budgets` allows.
        """
        if not np.isfinite([phase, velocity, age]).all():
            raise UsageError('an estimate of phase and phase velocity must be finite')
        if max(abs(phase), abs(velocity)) > LARGEST_PHASE:
            raise UsageError(f'an estimate of phase {phase:.3g} and phase velocity {velocity:.3g} is refused: '
                             f'{LARGEST_PHASE:g} at most')
        phase = phase % TURN
        velocity = float(np.clip(velocity, self._lowest, self._highest))
        goal = phase + velocity * max(age, 0.0)
        if not self.ready:
            self._goal, self._velocity, self.ready = goal, velocity, True
            self._speed = Glide(1.0)
        else:
            here, speed = self._goal + self._gap, self._rate()
            self._gap = float((here - goal + np.pi) % TURN - np.pi)
            self._goal, self._velocity = goal, velocity
            self._closing = speed - velocity * self._speed.at()
            if self._silent > self._coast:
                self._speed.go(1.0, 0.5 * self._stop)
        self._silent = 0.0

    def _rate(self):
        return self._velocity * self._speed.at() + self._closing

    def _pull(self, ahead):
        """Gap and its rate: the solution of x'' + 2 k x' + k^2 x = 0."""
        k = self._stiffness
        decay = np.exp(-k * ahead)
        slope = self._closing + k * self._gap
        return (self._gap + slope * ahead) * decay, (slope - k * (self._gap + slope * ahead)) * decay

    def window(self, ahead):
        """See `MotionSource.window`."""
        ahead = np.asarray(ahead, dtype=float)
        gap, closing = self._pull(ahead)
        phase = self._goal + self._velocity * self._speed.integral(ahead) + gap
        positions, by_phase, by_time = self._pose(ahead, phase)
        rate = self._velocity * self._speed.at(ahead) + closing
        return positions, by_phase * rate[:, None] + by_time

    def advance(self, dt):
        """See `MotionSource.advance`."""
        self._gap, self._closing = (float(x) for x in self._pull(np.float64(dt)))
        self._goal = float((self._goal + self._velocity * self._speed.integral(dt)) % TURN)
        heard = self._silent <= self._coast
        self._silent += dt
        if heard and self._silent > self._coast:
            self._speed.go(0.0, self._stop)
        super().advance(dt)

    def set_speed(self, speed, seconds):
        """Refuse: the person sets the speed."""
        raise UsageError('when following, the person sets the speed')
