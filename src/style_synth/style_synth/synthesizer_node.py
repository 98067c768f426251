"""Stream the trajectory of a robot from a model and a style: the synthesizer as a lifecycle node."""
import sys
import threading
from pathlib import Path
from time import perf_counter

import rclpy
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.task import Future

from style_core.errors import ModelError, MotionError, UsageError
from style_core.live.health import OK, WARN, Health
from style_core.live.stamp_policy import NANOSECONDS
from style_core.live.tally import Tally
from style_core.synthesis.repertoire import list_models, load_repertoire
from style_core.synthesis.retargeting import plain_robot, read_robot
from style_core.synthesis.stage import Stage, style_bounds
from style_msgs.msg import StateSequence, StyleEstimate, StyleVector
from style_msgs.srv import ListStyles, LoadModel, SetStyle
from style_predictor.lifecycle import SoundLifecycleNode, transition
from style_predictor.outputs import diagnostics_message
from style_predictor.ros_parameters import declare, values_of, watch
from style_synth.action import SynthesizeServer
from style_synth.inputs import score_of
from style_synth.outputs import Outputs, status_message, style_message
from style_synth.parameters import SYNTHESIZER, options_of, settings_of, window_of

__all__ = ['SynthesizerNode', 'main']

ESTIMATE_QOS = QoSProfile(depth=8, reliability=ReliabilityPolicy.BEST_EFFORT)
STATUS_EVERY_S = 0.2
#: a longer pause between two ticks is not made up for, s
LONGEST_TICK_S = 0.2


class SynthesizerNode(SoundLifecycleNode):
    """See ``docs/synthesizer.md`` for topics, services, the action and parameters."""

    def __init__(self, **options):
        super().__init__('synthesizer', **options)
        self.stage = None
        self.active = False
        self._loading = False
        declare(self, SYNTHESIZER)
        watch(self, SYNTHESIZER, lambda: self.stage is not None, self._apply)

    # --- lifecycle ----------------------------------------------------------------------------------------------

    @transition
    def on_configure(self, state):
        """Load model, recording and robot; make the interfaces."""
        self._values = values = values_of(self, SYNTHESIZER)
        self._ahead = window_of(values)
        self.step = values['step']
        robot = read_robot(self._config('robots', values['robot'])) if values['robot'] else plain_robot()
        stage = Stage(self._load(values['model']), robot, settings_of(values))
        self._start(stage, values)
        stage.window(self._ahead)   # warm
        self.stage = stage
        self._tally = Tally()
        self._outputs = Outputs(self, stage.joint_names, self._ahead)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        overrides = QoSOverridingOptions.with_default_policies()
        self._heard = [
            self.create_subscription(StateSequence, '~/sequence', self._on_sequence, 5,
                                     qos_overriding_options=overrides),
            self.create_subscription(StyleVector, '~/style', self._on_style, 5, qos_overriding_options=overrides),
            self.create_subscription(StyleEstimate, 'estimate', self._on_estimate, ESTIMATE_QOS,
                                     qos_overriding_options=overrides)]
        self._served = [
            self.create_service(SetStyle, '~/set_style', self._on_set_style),
            self.create_service(ListStyles, '~/list_styles', self._on_list_styles),
            self.create_service(LoadModel, '~/load_model', self._on_load_model,
                                callback_group=MutuallyExclusiveCallbackGroup())]
        self._action = SynthesizeServer(self)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers_made = [self.create_timer(1.0 / values['rate'], self._tick),
                             self.create_timer(1.0, self._report, clock=steady)]
        self._told, self._status_due, self._at_rest = None, 0.0, False
        repertoire = stage.repertoire
        self.get_logger().info(f'configured with {repertoire.name or "a recording"} for {robot.name}: '
                               f'{len(stage.joint_names)} joints, mode {stage.mode}')
        return TransitionCallbackReturn.SUCCESS

    def _start(self, stage, values):
        stage.style_text = values['style']
        stage.choose(values['mode'], **options_of(values, values['mode']))
        if values['style'] and stage.source is not None:
            stage.style_for(stage.source, values['style'])   # says what is wrong with it

    @transition
    def on_activate(self, state):
        """Stream from now on."""
        result = super().on_activate(state)
        self._clock_was = self._published = self._now()
        self._describe()
        self.active = True
        return result

    @transition
    def on_deactivate(self, state):
        """Fall silent; the robot's bridge brakes."""
        self.active = False
        return super().on_deactivate(state)

    def _tear_down(self):
        self.active = False
        if self.stage is None:
            return
        self._action.destroy()
        self.stage = None
        for one in self._heard:
            self.destroy_subscription(one)
        for one in self._served:
            self.destroy_service(one)
        for one in self._timers_made:
            self.destroy_timer(one)
        self.destroy_publisher(self._diagnostics)
        self._outputs.destroy()

    # --- files --------------------------------------------------------------------------------------------------

    def _config(self, folder, name=''):
        try:
            base = Path(get_package_share_directory('style_bringup'))
        except PackageNotFoundError:
            base = Path.cwd()
        return base / 'config' / folder / name

    def _models_folder(self):
        return Path(self._values['models_folder']) if self._values['models_folder'] else self._config('models')

    def _load(self, model):
        values = self._values
        return load_repertoire(self._models_folder() / model if model else '', values['file'], values['skeleton'])

    def _describe(self):
        self._outputs.describe(self.stage.repertoire, list_models(self._models_folder()), self.stage.source,
                               self.stage.joint_names)

    # --- input --------------------------------------------------------------------------------------------------

    def _apply(self, values):
        """Take over live parameters; UsageError refuses the change as a whole."""
        if self.stage is None:
            return
        old, stage = self._values, self.stage
        stage.settings = settings_of(values)
        try:
            if values['style'] != old['style'] and values['style']:
                stage.set_style(values['style'])
            if any(values[name] != old[name] for name in ('mode', 'behaviour', 'seed', 'loop')):
                stage.choose(values['mode'], **options_of(values, values['mode']))
                if self.active:
                    self._describe()
            elif values['speed'] != old['speed'] and stage.source is not None:
                stage.source.set_speed(values['speed'], values['transition_time'])
        except (ModelError, MotionError) as error:
            raise UsageError(str(error)) from None
        self._values = values

    def _refused(self, what, error):
        self._tally.count(f'{what} refused')
        self.get_logger().warning(f'{what} refused: {error}', throttle_duration_sec=1.0)

    def _on_sequence(self, message):
        if not self.active:
            return
        try:
            score = score_of(message)
            if score is None:
                raise UsageError('it is empty')
            self.stage.choose('sequence', score=score, **options_of(self._values, 'sequence'))
        except (UsageError, ModelError) as error:
            self._refused('sequence', error)

    def _on_style(self, message):
        if not self.active:
            return
        try:
            self.stage.set_style(message.name if not len(message.values) else message.values)
        except UsageError as error:
            self._refused('style', error)

    def _on_estimate(self, message):
        if not self.active:
            return
        if message.status != StyleEstimate.TRACKING or message.discrete:
            self._tally.count('estimates not followed')
            return
        behaviour = ''
        if message.behaviours:
            best = max(range(len(message.behaviours)), key=message.behaviour_probabilities.__getitem__)
            behaviour = message.behaviours[best]
        stamp = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
        age = min(max((self._now() - stamp) / NANOSECONDS, 0.0), 0.2) if stamp else 0.0
        style = message.style if message.model == self.stage.repertoire.name else None
        try:
            self._pass_time()
            if self.stage.observe(message.phase, message.phase_velocity, behaviour, style, age):
                self._publish()
            else:
                self._tally.count('estimates not followed')
        except UsageError as error:
            self._refused('estimate', error)

    def _on_set_style(self, request, response):
        style, stage = request.style, self.stage
        try:
            stage.set_style(style.name if not len(style.values) else style.values, request.transition_time)
            response.success = True
        except UsageError as error:
            response.message = str(error)
        if stage.source is not None:
            response.style = style_message(stage.source, stage.source.target)
        return response

    def _on_list_styles(self, request, response):
        response.model, source = self.stage.repertoire.name, self.stage.source
        if source is not None and len(source.target):
            response.labels = list(source.labels)
            response.lower, response.upper = (bound.tolist() for bound in style_bounds(source))
            response.styles = [style_message(source, v) for v in source.styles.values()]
            for style, name in zip(response.styles, source.styles):
                style.name = name
        return response

    async def _on_load_model(self, request, response):
        if self._loading:
            response.message = 'another model is being loaded'
        else:
            self._loading = True
            done = Future(executor=self.executor)
            threading.Thread(target=self._load_into, args=(request.path, done), daemon=True).start()
            loaded = await done
            self._loading = False
            try:
                if isinstance(loaded, Exception):
                    raise loaded
                if self.stage is None:
                    raise UsageError('the node was taken down meanwhile')
                self.stage.replace(loaded)
                if self.active:
                    self._describe()
                response.success = True
            except (UsageError, ModelError, MotionError, OSError) as error:
                response.message = str(error)
        if self.stage is not None:
            repertoire = self.stage.repertoire
            response.model, response.kind = repertoire.name, repertoire.kind
            response.joint_names = list(repertoire.joint_names)
        return response

    def _load_into(self, path, done):
        try:
            if not path:
                raise UsageError('give the path of a model file')
            done.set_result(self._load(path))
        except Exception as error:  # whatever it is, whoever asked must hear of it
            done.set_result(error)

    # --- time and output ----------------------------------------------------------------------------------------

    def _now(self):
        return self.get_clock().now().nanoseconds

    def stamp(self):
        """Now, as a message."""
        return self.get_clock().now().to_msg()

    def _pass_time(self):
        now = self._now()
        dt = min(max((now - self._clock_was) / NANOSECONDS, 0.0), LONGEST_TICK_S)
        self._clock_was = now
        self._action.work(dt)
        self.stage.advance(dt)

    def _tick(self):
        if not self.active:
            return
        self._pass_time()
        # estimates are answered at once; the timer only fills their silence
        following = self.stage.mode == 'follow' and \
            self._clock_was - self._published < 1.5 * NANOSECONDS / self._values['rate']
        if not following:
            self._publish()
        standing = self.stage.standing()
        if (standing.state, standing.message) != self._told or perf_counter() >= self._status_due:
            self._told, self._status_due = (standing.state, standing.message), perf_counter() + STATUS_EVERY_S
            source = None if self.stage.performer is None else self.stage.performer.source
            self._outputs.status(status_message(standing, source, self.stage.repertoire.name, self.stamp()))

    def _publish(self):
        started = perf_counter()
        # one window more than needed, so that the last one is at rest
        if self._at_rest and self.stage.finished:
            return
        self._at_rest = self.stage.finished
        window = self.stage.window(self._ahead)
        if window is None:
            return
        self._outputs.window(self._clock_was, *window)
        self._published = self._clock_was
        self._tally.time('window', perf_counter() - started)
        self._tally.count('windows')
        if perf_counter() - started > self._values['deadline']:
            self._tally.count('missed deadlines')

    def _report(self):
        health = self._health() if self.active else Health(WARN, 'not active', {})
        self._diagnostics.publish(diagnostics_message(self.stamp(), f'{self.get_name()}: motion synthesis', health,
                                                      self.stage.repertoire.name))

    def _health(self):
        standing, counts = self.stage.standing(), self._tally.total
        fresh = self._tally.fresh()
        median, high = self._tally.percentiles('window')
        facts = {'mode': self.stage.mode, 'state': str(standing.state), 'message': standing.message or 'none',
                 'windows in the last report': str(fresh['windows']),
                 'window time p50, p99 (ms)': f'{1e3 * median:.3f}, {1e3 * high:.3f}',
                 **{name: str(counts[name]) for name in sorted(counts)}}
        refused = [f'{count} {name}' for name, count in fresh.items() if 'refused' in name and count]
        if fresh['missed deadlines']:
            refused.append(f'{fresh["missed deadlines"]} deadlines missed')
        trouble = ', '.join(refused + ([standing.message] if 'estimates' in standing.message else []))
        return Health(WARN if trouble else OK, trouble or standing.message or 'performing', facts)


def main(args=None):
    """Run the node until it is told to stop."""
    sys.setswitchinterval(0.0005)  # a model loading in its thread must not hold up windows
    rclpy.init(args=args)
    node = None
    try:
        node = SynthesizerNode()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except UsageError as error:
        print(f'synthesizer: {error}', file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
