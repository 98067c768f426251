"""The action Synthesize: one motion, streamed to the robot or just computed."""
import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from style_core.budgets import ERROR_TEXT, GOAL_S
from style_core.errors import ModelError, MotionError, UsageError
from style_core.synthesis.performer import Performer, window_times
from style_core.text import shown
from style_msgs.action import Synthesize
from style_synth.inputs import score_of
from style_synth.outputs import status_message, trajectory_message

__all__ = ['SynthesizeServer']

#: of motion computed between two looks at everything else, s
CHUNK_S = 0.5
#: further ahead that counts, s
AHEAD_S = 0.3
MOST_S = GOAL_S
STOP_S = 0.5


class _Job:
    """One goal on its way."""

    def __init__(self, handle, source, duration, stream, step, joints):
        self.handle, self.source, self.duration, self.stream, self.step = handle, source, duration, stream, step
        self.joints = joints
        self.time, self.stopping, self.positions, self.velocities = 0.0, False, [], []
        self.done = Future()
        self.outcome, self.performer, self.end = '', None, 0.0

    def record(self, performer, seconds):
        """Note the next ``seconds`` of what a performer's last window says."""
        count = int(np.floor((self.time + seconds) / self.step + 1e-9)) - int(np.floor(self.time / self.step + 1e-9))
        offset = (np.floor(self.time / self.step + 1e-9) + 1) * self.step - self.time
        if count:
            positions, velocities = performer.at(offset + self.step * np.arange(count))
            self.positions.append(positions)
            self.velocities.append(velocities)
        self.time += seconds

    def result(self):
        """The message of the result."""
        result = Synthesize.Result(success=self.outcome == '', message=self.outcome)
        if self.positions:
            positions, velocities = np.concatenate(self.positions), np.concatenate(self.velocities)
            result.trajectory = trajectory_message(self.joints, self.step * np.arange(1, len(positions) + 1), positions,
                                                   velocities)
        return result


class SynthesizeServer:
    """Serve ``~/synthesize``; one goal at a time, in pieces between the node's ticks.

    Parameters
    ----------
    node : SynthesizerNode
    """

    def __init__(self, node):
        self._node, self._job, self._taken = node, None, False
        self._server = ActionServer(node, Synthesize, '~/synthesize', self._execute, goal_callback=self._judge,
                                    cancel_callback=lambda handle: CancelResponse.ACCEPT)

    def give_up(self):
        """End what runs; its client gets a result that says so."""
        if self._job is not None and not self._job.done.done():
            self._finish('the node was taken down')

    def _judge(self, request):
        if self._taken or not self._node.active:
            self._node.get_logger().warning('goal refused: ' + ('another one is being performed' if self._taken else
                                                                'the node is not active'))
            return GoalResponse.REJECT
        self._taken = True
        return GoalResponse.ACCEPT

    async def _execute(self, handle):
        try:
            self._job = self._make(handle)
            if self._job.stream:
                self._node.stage.perform(self._job.source)
            else:
                self._job.performer = Performer(self._job.source, self._node.stage.robot)
            await self._job.done
            job = self._job
            if handle.is_cancel_requested:
                handle.canceled()
            elif job.outcome:
                handle.abort()
            else:
                handle.succeed()
            return job.result()
        except (UsageError, ModelError, MotionError) as error:
            handle.abort()
            return Synthesize.Result(success=False, message=str(error))
        except Exception as error:  # the client hears of it, and the node stays
            self._node.executor.failures.note(error, self._node.get_logger())
            handle.abort()
            return Synthesize.Result(success=False, message=shown(f'{type(error).__name__}: {error}', ERROR_TEXT))
        finally:
            self._job, self._taken = None, False

    def _make(self, handle):
        request, node = handle.request, self._node
        if not (np.isfinite([request.duration, request.speed]).all() and 0 <= request.duration <= MOST_S
                and 0 <= request.speed <= 5):
            raise UsageError(f'duration must be 0 to {MOST_S:g} s and speed 0 to 5')
        repertoire, score, speed = node.stage.repertoire, score_of(request.sequence), request.speed or 1.0
        if score is not None:
            source = repertoire.source('sequence', score=score, speed=speed, lag=node.stage.settings.lag)
        elif 'cycle' in repertoire.modes:
            source = repertoire.source('cycle', behaviour=request.behaviour, speed=speed)
        elif 'random_walk' in repertoire.modes:
            source = repertoire.source('random_walk', speed=speed, seed=int(request.seed) % 2**63,
                                       lag=node.stage.settings.lag)
        else:
            source = repertoire.source('effort' if 'effort' in repertoire.modes else 'file', speed=speed, loop=False)
        self._dress(source, request.style)
        duration = request.duration or source.remaining
        if not np.isfinite(duration):
            duration = getattr(source, 'period', 0.0)
        if not 0 < duration <= MOST_S:
            raise UsageError(f'the duration must lie between 0 and {MOST_S:g} s; here it would be {duration:g} s')
        return _Job(handle, source, duration, request.stream, node.step, node.stage.joint_names)

    def _dress(self, source, style):
        stage = self._node.stage
        if style.name or len(style.values):
            v = stage.style_for(source, style.name, style.values)
        elif stage.style_text and len(source.target):
            try:
                v = stage.style_for(source, stage.style_text)
            except UsageError:
                return  # the style in force belongs to another kind of motion
        else:
            return
        source.set_style(v, 1e-3)
        source.advance(1e-3)

    def work(self, dt):
        """Go on with the goal for one tick of ``dt`` seconds; called by the node before it advances the stage."""
        job = self._job
        if job is None or job.done.done():      # its coroutine may go on a tick later
            return
        if job.stream:
            self._stream(job, dt)
        else:
            self._compute(job)
        if not job.done.done():
            stage = self._node.stage
            job.handle.publish_feedback(Synthesize.Feedback(
                status=status_message(stage.standing(), stage.source, stage.repertoire.name, self._node.stamp()),
                progress=float(min(job.time / job.duration, 1.0))))

    def _compute(self, job):
        if job.handle.is_cancel_requested:
            self._finish('cancelled')
            return
        seconds = min(CHUNK_S, job.duration - job.time)
        job.performer.window(window_times(job.step, CHUNK_S + AHEAD_S))
        job.record(job.performer, seconds)
        job.performer.advance(seconds)
        if job.time >= job.duration - 1e-9:
            self._finish('')

    def _stream(self, job, dt):
        stage = self._node.stage
        if stage.source is not job.source:
            self._finish('something else was chosen meanwhile')
            return
        job.record(stage.performer, dt)
        ending = job.time >= job.duration - STOP_S or job.handle.is_cancel_requested
        if ending and not job.stopping and np.isfinite(job.duration):
            job.stopping = True
            if job.source.remaining > STOP_S:
                job.source.set_speed(0.0, STOP_S)
            job.end = job.time + STOP_S
        if job.stopping and job.time >= job.end:
            self._finish('cancelled' if job.handle.is_cancel_requested else '')

    def _finish(self, outcome):
        self._job.outcome = outcome
        if self._job.stream:
            self._node.stage.resume()
        self._job.done.set_result(True)
