"""The servo bridge without ROS: from trajectories to limited commands, tick by tick."""
import logging
import math
import time
from collections import deque

import numpy as np

from style_core.errors import MotionError, UsageError
from style_core.follow.limiter import CLAMP, REJECT, Limiter
from style_core.follow.plan import Foresight
from style_core.follow.playback import Playback, make_track
from style_servo.backend import BackendFault, Coming
from style_servo.bridge_settings import BridgeSettings, Points
from style_servo.holding import Holding
from style_servo.states import Event, State, StateMachine

__all__ = ['Bridge', 'BridgeSettings', 'Points']

log = logging.getLogger(__name__)

MAX_PENDING = 16        # trajectories that start in the future
CATCH_UP_S = 0.05       # of missed periods that a late tick makes up for
EARLY = 0.1             # of a period
REJECT_RUN = 3          # ticks in a row with rejected targets that end a trajectory
LOOKS = 5               # tries to read the posture when arming
NOTABLE_LAG = 0.02      # rad
PLAYING = State.READY, State.RAMPING, State.STREAMING
POSTURE_TOLERANCE = 0.05        # rad that a posture may lie outside the limits when arming


class Bridge:
    """Everything between a trajectory and the motors.

    All methods take ``now``, the time in s on one monotonic clock.

    Parameters
    ----------
    chain : Chain
    backend : Backend
    settings : BridgeSettings

    Attributes
    ----------
    state : State
    reason : str
        Why the bridge stands in a state that needs attention; '' while all is well.
    command, command_velocity : ndarray, shape (D,)
        The last command, rad and rad/s; NaN before the first.
    bands : ndarray, shape (D,)
        Of the last command: PASS, CLAMP or REJECT.
    target : ndarray, shape (D,)
        What the last command aimed at before limiting, rad.
    lag : ndarray, shape (D,)
        How far the last command stayed behind its target (brought inside the position limits), rad.
    playing : float
        Stamp of the trajectory that plays, s as its sender gave it; 0 where it had none, NaN before the first.
    ticked : float
        Time that the commands have come to, s: a whole number of periods after the bridge was armed first.
    trace : callable, optional
        Called for every period's command with time, state, target, command, measured position and ``playing``.
    pressed : callable
        Takes the time; returns why the emergency stop counts as pressed, '' if it does not. Asked before every command:
        while it is pressed nothing arms, resets or moves, whatever happens in which order.
    counts : dict
        Trajectories accepted and rejected (by reason), joint commands clamped and rejected, errors of the program.
    """

    def __init__(self, chain, backend, settings):
        self.chain, self.backend, self.settings = chain, backend, settings
        self._names = names = chain.names
        self._index = {name: i for i, name in enumerate(names)}
        velocity, acceleration = chain.array('velocity'), chain.array('acceleration')
        self._limiter = Limiter(chain.array('lower'), chain.array('upper'), velocity, acceleration,
                                chain.array('discontinuity'), 1.0 / settings.rate)
        self._playback = Playback(len(names), velocity, acceleration)
        # a command is made so long before its time
        self._lead = getattr(backend, 'lead', 0.0)
        self._foresight = Foresight(self._limiter, self._playback, self._lead)
        self._foreseen = 0          # periods that the back end knows already and drives without us
        # what the way to a first point may ask of the joints, from a held posture and while streaming
        self._feasible = {False: (velocity / 1.5, acceleration), True: (2.0 * velocity, np.inf)}
        self._jump = chain.array('discontinuity')
        self._lower, self._upper = chain.array('lower'), chain.array('upper')
        self._follow = chain.array('following_error')
        self._stopping_time = float(np.max(velocity / acceleration))
        self._holding = Holding(np.minimum(self._follow, settings.hold_error), settings.following_time)
        self._still = np.zeros(len(names))
        self.machine = StateMachine()
        self.reason = ''
        self.command, self.command_velocity = self._limiter.position, self._limiter.velocity
        self.bands = self._limiter.bands
        self.target = np.full(len(names), np.nan)
        self.lag = np.zeros(len(names))
        self._behind = np.zeros(len(names), dtype=int)      # periods that a joint has lagged too far
        self._worst_lag = np.zeros(len(names))
        self.counts = {'accepted': 0, 'rejected': 0, 'clamped': 0, 'limiter rejections': 0, 'internal errors': 0}
        self.rejections = {}
        self.pressed = lambda now: ''
        self.trace = None
        self.playing = math.nan
        self.ticked = math.nan
        self._begun = -math.inf     # when what plays took over
        self._pending = deque()
        self._accepted_at = -math.inf
        self._since = self._ramp_end = 0.0
        self._reject_run = 0
        self._following_since = None
        self._torque = False
        self._lost = self._backend_fault = False

    @property
    def state(self):
        """The current state."""
        return self.machine.state

    @property
    def moving(self):
        """Whether the last command still moves."""
        return not self._limiter.stopped

    def input_age(self, now):
        """Time since the last accepted trajectory, s; infinite before the first."""
        return now - self._accepted_at

    def take_lag(self):
        """Joint that lagged furthest behind its target since the last call, and by how much (rad), or None."""
        lags, self._worst_lag = self._worst_lag, np.zeros_like(self._worst_lag)
        worst = int(np.argmax(lags))
        lag = float(lags[worst])
        return (self.chain.names[worst], lag) if lag > NOTABLE_LAG else None

    # --- arming and stopping ------------------------------------------------------------------------------------

    def arm(self, now):
        """Torque on at the measured posture. Raises UsageError or BackendFault; then the bridge stays disarmed."""
        self._refuse_if_pressed(now)
        if not self.machine.allows(Event.ARM):
            raise UsageError(f'cannot arm while {self.state.name}')
        self._take_posture(now)
        try:
            self._refuse_if_pressed(now)    # and so does this
        except UsageError:
            self._torque_off()
            raise
        self.machine.happen(Event.ARM)
        self._enter(now, '')
        self._trace(now)

    def _refuse_if_pressed(self, now):
        reason = self.pressed(now)
        if reason:
            raise UsageError(f'the emergency stop is still pressed ({reason})')

    def disarm(self, now):
        """Torque off; brake first with :meth:`stop`."""
        self.backend.disable()
        self._torque = False
        self.machine.happen(Event.DISARM)
        self._enter(now, '')
        self._trace(now)

    def stop(self, now, clock=time.monotonic, sleep=time.sleep):
        """Brake to a stand, running its own ticks; used when a node is deactivated or the program ends."""
        end = now + 2 * self._stopping_time + 0.2
        period = 1.0 / self.settings.rate
        while self._torque and not self._lost and self.moving and clock() < end:
            reason = self.pressed(clock())
            if reason:
                self.estop(clock(), reason)     # which may mean torque off at once
            if not self._torque:
                break
            self.ticked += period
            self._brake(clock() + self._lead)
            self._drive(clock())
            sleep(min(period, max(0.0, self.ticked + period - clock())))

    def _take_posture(self, now):
        """Check the posture, torque on, and start everything from it."""
        for _ in range(LOOKS):
            self.backend.observe()
            if self.backend.measurement.fresh:
                break
        posture = self.backend.measurement.position.copy()
        outside = np.maximum(self._lower - posture, posture - self._upper)
        if not self.backend.measurement.fresh:
            raise UsageError('the posture of the joints is not known: not all of them answer')
        if not np.all(outside <= POSTURE_TOLERANCE):
            worst = int(np.nanargmax(outside))
            raise UsageError(f'joint {self.chain.names[worst]} stands at {posture[worst]:.3f} rad, outside its limits '
                             f'{self._lower[worst]:.3f} to {self._upper[worst]:.3f}: move it inside by hand')
        self._refuse_if_pressed(now)    # connecting and looking take time
        self.backend.enable()
        posture = self.backend.measurement.position.copy()
        self._torque, self._lost, self._backend_fault = True, False, False
        self._limiter.reset(posture)
        self._playback.hold(posture)
        self._foresight.begin()
        self._foreseen = 0
        # a reset keeps in step with whoever calls tick
        period = 1.0 / self.settings.rate
        self.ticked = now if math.isnan(self.ticked) else now - (now - self.ticked) % period
        self.target[:] = posture
        self._pending.clear()
        self._following_since = None
        self._reject_run = 0

    def estop(self, now, reason='emergency stop'):
        """Stop now: the next command brakes, or torque goes off at once."""
        if self.machine.happen(Event.ESTOP):
            self._enter(now, reason)
        # a latched fault or an emergency stop before may have left the motors holding
        if self.settings.estop_action == 'torque_off' and self._torque and not self._lost:
            self._torque_off()

    def fault(self, now, reason):
        """Latch a fault."""
        if self.machine.happen(Event.FAULT):
            log.error('%s', reason)
            self._enter(now, reason)
            if self.settings.fault_action == 'torque_off':
                self._torque_off()

    def reset(self, now):
        """Leave FAULT, ESTOP, HOLDING or RELAXED and stand ready at the measured posture.

        Raises
        ------
        UsageError, BackendFault
            When there is nothing to reset, the emergency stop is still pressed, or the motors are not well.
        """
        if not self.machine.allows(Event.RESET):
            raise UsageError(f'nothing to reset while {self.state.name}')
        self._refuse_if_pressed(now)
        if self.moving and self._torque and not self._lost:
            raise UsageError('the joints still brake: try again when they stand')
        try:
            if self._backend_fault:
                self._torque = False
                self.backend.connect()      # start from a checked bus
            self._take_posture(now)
        except (BackendFault, UsageError) as error:
            self.reason = f'reset failed: {error}'
            raise
        self.machine.happen(Event.RESET)
        self._enter(now, '')
        self._trace(now)

    def _torque_off(self):
        self._torque = False
        self.backend.disable()

    def _enter(self, now, reason):
        self._since = now
        self.reason = reason
        self._pending.clear()
        self._holding.start()
        self._reject_run, self._behind[:] = 0, 0

    # --- trajectories -------------------------------------------------------------------------------------------

    def submit(self, points, start, now, stamp=0.0):
        """Take a trajectory that starts at ``start`` (s, on the clock of ``now``); its sender's ``stamp`` is kept.

        Raises
        ------
        MotionError
            With the reason why it is refused; what plays goes on.
        """
        try:
            self._submit(points, start, now, stamp)
        except MotionError as error:
            self.count_rejection(error)
            raise

    def count_rejection(self, error):
        """Count a trajectory that is not taken, by the first words of the reason."""
        self.counts['rejected'] += 1
        kind = getattr(error, 'kind', 'unusable')
        self.rejections[kind] = self.rejections.get(kind, 0) + 1

    def _submit(self, points, start, now, stamp):
        state = self.state
        if not (state in (State.READY, State.RAMPING, State.STREAMING)
                or (state is State.HOLDING and not self.settings.latch_hold)):
            raise _refusal('wrong state', f'no trajectories are taken while {state.name}'
                           + (': call reset first' if state.armed else ''))
        if not start <= now + self.settings.max_lead:
            raise _refusal('future', f'it starts {start - now:.3f} s in the future '
                                     f'(at most {self.settings.max_lead:g})')
        points = self._complete(points)
        # what was commanded for the time before stands
        at = self.ticked + 1.0 / self.settings.rate + self._lead if self._lead else now
        if start > at:
            self._check_points(points, start, at)
            # it replaces what was to start at or after it
            while self._pending and self._pending[-1][1] >= start:
                self._pending.pop()
            if len(self._pending) == MAX_PENDING:
                raise _refusal('queue full', f'{MAX_PENDING} trajectories already wait for their start')
            self._pending.append((points, start, stamp))
            self._accept(now)
            return
        self._begin(points, start, at, stamp)
        self._accept(now)

    def _accept(self, now):
        self._accepted_at = now
        self.counts['accepted'] += 1

    def _complete(self, points):
        """Columns in the order of the chain; joints that are not named hold."""
        names = tuple(points.joint_names)
        if names == self._names:
            return points
        if len(set(names)) != len(names):
            raise _refusal('joints', 'a joint is named twice')
        unknown = [name for name in names if name not in self._index]
        if unknown:
            raise _refusal('joints', f'unknown joint {", ".join(unknown[:5])}')
        missing = [name for name in self._names if name not in names]
        if missing and (not self.settings.partial_joints or not names):
            raise _refusal('joints', f'no values for joint {", ".join(missing[:5])}')
        columns = [self._index[name] for name in names]

        def spread(array, fill):
            if array is None:
                return None
            array = np.asarray(array, dtype=np.float64)
            if array.ndim != 2 or array.shape[1] != len(names):
                raise _refusal('shape', f'{len(names)} joints but values of shape {array.shape}')
            whole = np.tile(fill, (len(array), 1))
            whole[:, columns] = array
            return whole
        zero = np.zeros(len(self.chain.names))
        held = self.command if np.all(np.isfinite(self.command)) else zero
        return Points(self.chain.names, points.times, spread(points.positions, held), spread(points.velocities, zero),
                      spread(points.accelerations, zero))

    def _check_points(self, points, start, now):
        standing = self.command, np.zeros_like(self.command)
        return make_track(start + points.times, points.positions, points.velocities, points.accelerations, start=start,
                          now=now, current=standing, coast=self.settings.coast)

    def _begin(self, points, start, now, stamp):
        """Let a trajectory whose start has come take over."""
        streaming = self.state in (State.RAMPING, State.STREAMING)
        if streaming:
            position, velocity = (array.copy() for array in self._playback.source(now))
        else:
            position, velocity = self.command.copy(), self.command_velocity.copy()
        if points.positions.shape[1:] != position.shape:
            raise _refusal('shape', f'positions of shape {points.positions.shape} for {len(position)} joints')
        track = make_track(start + points.times, points.positions, points.velocities, points.accelerations,
                           start=max(start, now), now=now, current=(position, velocity), coast=self.settings.coast,
                           within=self._feasible[streaming], shortest=self.settings.blend if streaming else 0.0)
        if streaming:
            gap = np.abs(self._playback.jump(track, now)[0])
            worst = int(np.argmax(gap / self._jump))
            if gap[worst] > self._jump[worst]:
                raise _refusal('discontinuity', f'joint {self.chain.names[worst]} would jump by {gap[worst]:.3f} rad')
            self._playback.take_over(track, now, self.settings.blend)
        else:
            ramp = self._playback.ramp_in(track, now, self.settings.ramp_time, self.settings.ramp_speed,
                                          position, velocity, self._limiter.stop()[0])
            self._ramp_end = now + ramp
            self.machine.happen(Event.TRAJECTORY)
            self._since, self.reason = now, ''
            self._reject_run, self._behind[:] = 0, 0
        self.playing, self._begun = stamp, now

    def _begin_waiting(self, points, start, stamp, now):
        try:
            self._begin(points, start, now, stamp)
        except MotionError as error:
            self.counts['accepted'] -= 1
            self.count_rejection(error)
            log.warning('trajectory refused at its start: %s', error)

    # --- the tick -----------------------------------------------------------------------------------------------

    def tick(self, now):
        """One cycle: choose the reference, limit it, send it, read back, check. Call it ``rate`` times a second.

        The limits hold in steps of one period. A call that comes late makes up for the periods missed (up to
        CATCH_UP_S of them, each limited by itself) and sends the last; one that comes more than EARLY
        of a period too soon is left out.

        Returns
        -------
        periods : int
            Made up for; 0 if left out.
        """
        if not self.state.armed:
            return 0
        period = 1.0 / self.settings.rate
        periods = math.floor((now - self.ticked) / period + EARLY)
        if periods < 1:
            return 0
        most = max(1, round(CATCH_UP_S / period))
        # what is left of rounding counts for the next call, so that the mean rate is right
        self.ticked += periods * period
        reason = self.pressed(now)
        if reason:
            self.estop(now, reason)
        if self._lead:
            self._follow_plan(periods)
        else:
            if periods > most and self.state in PLAYING:
                # time is lost, so the target has moved on: that is no jump of the sender's
                self._limiter.expect(self._playback.sample(max(now - most * period, self._begun))[0])
            periods = min(periods, most)
            for k in range(periods - 1, -1, -1):
                self._step_soundly(now - k * period)
        self._foreseen = max(0, self._foreseen - periods)
        self._drive(now)
        return periods

    def _follow_plan(self, periods):
        """Limit the commands of some periods, of which the back end has driven all but the last by the plan it has."""
        period = 1.0 / self.settings.rate
        for k in range(1, periods + 1):
            at = self.ticked + self._lead - (periods - k) * period
            if k <= self._foreseen or k == periods:
                if k > self._foreseen + 1 and self.state in PLAYING:
                    # it has braked meanwhile; the target has moved on, and that is no jump of the sender's
                    self._limiter.expect(self._playback.sample(max(at, self._begun))[0])
                self._step_soundly(at)
            else:
                self._brake(at)

    def _plan(self, ahead):
        """The trajectory of the commands, ``ahead`` s and the way to a stand beyond the last: see Foresight.plan."""
        self._foreseen = max(1, math.ceil(ahead * self.settings.rate - 1e-9))
        return self._foresight.plan(self.ticked + self._lead, self._foreseen, self.state in PLAYING)

    def _step_soundly(self, now):
        """Whatever goes wrong in choosing a reference is a fault, in which the joints brake."""
        steps = self._limiter.counts.sum()
        try:
            self._step(now)
        except Exception as error:
            self.counts['internal errors'] += 1
            log.exception('error of the program')
            self.fault(now, f'error of the program: {error!r}')
            if self._limiter.counts.sum() == steps:
                self._limiter.brake()
            self.target[:] = self.command
        self._noted(now)

    def _brake(self, now):
        self._limiter.brake()
        self.target[:] = self.command
        self._noted(now)

    def _noted(self, at):
        """Remember the command for ``at``, and show it to who looks on."""
        self._foresight.note()
        self._trace(at - self._lead)

    def _trace(self, now):
        if self.trace is None:
            return
        try:
            self.trace(now, self.state, self.target, self.command, self.backend.measurement.position, self.playing)
        except Exception:       # who looks on may not keep a command from being sent
            self.trace = None
            self.counts['internal errors'] += 1
            log.exception('error of the program: nobody looks on any more')

    def _step(self, now):
        """Limit one period's command."""
        at = max(now, self._begun)      # periods missed before a trajectory took over aim at its beginning
        self._advance(at)
        if self.state in PLAYING:
            position, velocity = self._playback.sample(at)
            self._limiter.step(position, velocity)
            self.target[:] = position
            self._judge_bands(at)
        else:
            self._hold(now)

    def _hold(self, now):
        """Brake; then stand, and give way where a joint is held away from its command."""
        measurement = self.backend.measurement
        posture = None
        if self._torque and measurement.fresh:
            posture = self._holding.reference(now, self.command, not self.moving, measurement.position)
        if posture is None:
            self._limiter.brake()
            self.target[:] = self.command
            return
        self._limiter.expect(posture)
        self._limiter.step(posture, self._still)
        self.target[:] = posture

    def _advance(self, now):
        """Everything that time alone brings about."""
        while self._pending and self._pending[0][1] <= now:
            self._begin_waiting(*self._pending.popleft(), now)
        state, settings = self.state, self.settings
        if state in (State.RAMPING, State.STREAMING):
            old = 0 < settings.input_timeout < self.input_age(now) and self._playback.ends_moving
            ended = now >= self._playback.end and not self._pending
            if state is State.RAMPING and now >= self._ramp_end and not old and not ended:
                self.machine.happen(Event.RAMPED)
                self._since = now
            elif ended and not self._playback.ends_moving:
                # a short trajectory may end before or as its ramp does
                if self.state is State.RAMPING:
                    self.machine.happen(Event.RAMPED)
                self.machine.happen(Event.FINISHED)
                self._playback.hold(self._playback.sample(now)[0].copy())
                self._enter(now, '')
            elif old or ended:
                self.machine.happen(Event.STALE)
                self._enter(now, f'no new trajectory for {self.input_age(now):.2f} s' if old else
                            'the trajectory ended while moving and none followed')
        elif state is State.HOLDING and now - self._since > settings.hold_timeout:
            if settings.hold_policy == 'relax':
                self.machine.happen(Event.TIRED)
                self._enter(now, f'relaxed: no trajectory for {self.input_age(now):.1f} s')
                self._torque_off()
            elif settings.hold_policy == 'fault':
                self.machine.happen(Event.GIVE_UP)
                self._enter(now, f'no trajectory for {self.input_age(now):.1f} s')
                if settings.fault_action == 'torque_off':
                    self._torque_off()

    def _judge_bands(self, now):
        clamped, rejected = np.count_nonzero(self.bands == CLAMP), np.count_nonzero(self.bands == REJECT)
        self.counts['clamped'] += int(clamped)
        self.counts['limiter rejections'] += int(rejected)
        self._reject_run = self._reject_run + 1 if rejected else 0
        if clamped:
            np.abs(np.clip(self.target, self._lower, self._upper) - self.command, out=self.lag)
            np.maximum(self.lag, self._worst_lag, out=self._worst_lag)
            self._behind = np.where(self.lag > self._jump, self._behind + 1, 0)
        else:
            self.lag[:] = self._behind[:] = 0
        if self._reject_run >= REJECT_RUN:
            joint = self.chain.names[int(np.argmax(self.bands == REJECT))]
            self._refuse(now, f'the target of joint {joint} jumps or is not finite')
        elif self._behind.max() > self.settings.saturation_time * self.settings.rate:
            joint = self.chain.names[int(np.argmax(self._behind))]
            self._refuse(now, f'joint {joint} has been too far behind its target for '
                              f'{self.settings.saturation_time:g} s: the trajectory asks for more than its limits')

    def _refuse(self, now, reason):
        if self.machine.happen(Event.REFUSED):
            self._enter(now, reason)
        else:
            self._playback.hold(self.command)       # READY: stay where the trajectory could not be followed to
        self._behind[:] = 0

    def _drive(self, now):
        if self._lost:
            return
        try:
            if self._torque:
                self.backend.exchange(self.command, self.command_velocity,
                                      Coming(self.ticked + self._lead, self._plan))
            else:
                self.backend.observe()
        except BackendFault as error:
            self._lost = error.connection_lost
            self._backend_fault = True
            self.fault(now, str(error))
            return
        except Exception as error:      # it is tried again in the next cycle; a reset checks everything anew
            self.counts['internal errors'] += 1
            if self.state is not State.FAULT:
                log.exception('error of the program')
            self._backend_fault = True
            self.fault(now, f'error of the program in the back end: {error!r}')
            return
        self._watch_following(now)

    def _watch_following(self, now):
        measurement = self.backend.measurement
        if not (self._torque and measurement.fresh) or self.state is State.FAULT:
            return
        due = self._foresight.due()
        error = np.abs(due - measurement.position)
        if np.all(error <= self._follow):
            self._following_since = None
        elif self._following_since is None:
            self._following_since = now
        elif now - self._following_since > self.settings.following_time:
            worst = int(np.nanargmax(error / self._follow))
            self.fault(now, f'joint {self.chain.names[worst]} does not follow: commanded {due[worst]:.3f}, '
                            f'measured {measurement.position[worst]:.3f} rad (blocked, overloaded, or limits too fast)')
            self._holding.start(error > self._follow)


def _refusal(kind, message):
    error = MotionError(message)
    error.kind = kind
    return error
