"""Joint states in, predicted joint trajectory out: the predictor as a lifecycle node."""
import gc
import sys
from time import perf_counter

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from style_core.errors import ModelError, MotionError, UsageError
from style_core.places import find_file
from style_core.stream.health import WARN, Health, health_of
from style_core.stream.joint_map import identity_map, read_joint_map
from style_core.stream.loading import load_live
from style_core.stream.stream import PredictorStream
from style_core.wire.joint_state_reader import JointStateReader
from style_msgs.srv import LoadModel, ResetEstimate, SetMask
from style_node.diagnostics import diagnostics_message
from style_node.executor import run
from style_node.lifecycle import SoundLifecycleNode, transition
from style_node.loader import Loader
from style_node.qos import overrides
from style_node.ros_parameters import declare, values_of, watch
from style_predictor.outputs import Outputs, Writers
from style_predictor.parameters import PREDICTOR, horizons_of, settings_of

__all__ = ['PredictorNode', 'main']

# best effort and volatile like all sensor data, but deep enough for a pause of some tens of ms at 1 kHz: what has
# arrived is taken at one go, and only the newest is answered
INPUT_QOS = QoSProfile(depth=64, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT)
MOST_AT_ONCE = 64
#: a report does not wait for the next message where none has come for so long, s
SILENCE = 0.1


class PredictorNode(SoundLifecycleNode):
    """See ``docs/predictor_node.md`` for topics, services and parameters."""

    def __init__(self, **options):
        super().__init__('predictor', **options)
        self._stream = None
        self._active = False
        declare(self, PREDICTOR)
        watch(self, PREDICTOR, lambda: self._stream is not None, self._apply)

    @transition
    def on_configure(self, state):
        """Load the model, warm it up, make publishers, services and the subscription."""
        self._values = values_of(self, PREDICTOR)
        if not self._values['model']:
            raise UsageError('the parameter model is empty: give the path of a model file')
        self._horizons = horizons_of(self._values)
        live, stream, writers = self._build(self._values['model'], self._horizons)
        masked = [pattern for pattern in self._values['masked_joints'] if pattern]
        if masked:
            stream.set_mask(masked, False)
        self._live, self._stream, self._writers = live, stream, writers
        self._outlook = None
        self._reader = JointStateReader()
        self._loader = Loader(self, self._load)
        self._next_publication = 0.0
        self._warned = set()
        self._report_due = False
        self._last_message = 0.0
        self._outputs = Outputs(self)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._subscription = self.create_subscription(
            JointState, 'joint_states', self._on_joint_states, INPUT_QOS, raw=True,
            qos_overriding_options=overrides())
        self._timer = self.create_timer(1.0, self._on_report_due, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._own_services = [
            self.create_service(SetMask, '~/set_mask', self._on_set_mask),
            self.create_service(ResetEstimate, '~/reset', self._on_reset),
            # waits for its thread without keeping joint states waiting, or the next request
            self.create_service(LoadModel, '~/load_model', self._on_load_model,
                                callback_group=ReentrantCallbackGroup())]
        gc.collect()
        gc.freeze()  # what is loaded now stays; the collector need not look at it again
        self.get_logger().info(f'configured with {live.name} ({live.method}), {len(stream.robot_joints)} joints, '
                               f'{len(self._horizons)} points to {self._horizons[-1]:.3f} s')
        return TransitionCallbackReturn.SUCCESS

    @transition
    def on_activate(self, state):
        """Start a search for the phase and publish from now on."""
        self._stream.reset()
        result = super().on_activate(state)
        self._outputs.describe(self._live, self._stream, self._horizons)
        self._active = True
        return result

    @transition
    def on_deactivate(self, state):
        """Fall silent; the model stays loaded."""
        self._active = False
        return super().on_deactivate(state)

    def _tear_down(self):
        self._active = False
        if self._stream is None:
            return
        self._stream = None
        self.destroy_subscription(self._subscription)
        self.destroy_timer(self._timer)
        self.destroy_publisher(self._diagnostics)
        for service in self._own_services:
            self.destroy_service(service)
        self._outputs.destroy()

    def _build(self, path, horizons):
        """Model, stream and writers, all warm."""
        values = self._values
        live = load_live(find_file(path, 'model', values['models_folder']), values['method'], horizons,
                         values['histories'], values['behaviour'], values['forgetting'])
        name = values['joint_map']
        joint_map = read_joint_map(find_file(name, 'joint map')) if name else identity_map()
        stream = PredictorStream(live.predictor, joint_map.bind(live.predictor.joint_names), settings_of(values))
        return live, stream, Writers(live, stream, horizons)

    def _apply(self, values):
        """Take over live parameters; called only with values that passed the checks."""
        if self._stream is None:
            return
        self._values = values
        self._stream.configure(settings_of(values))
        self._live.forget(values['forgetting'])
        horizons = horizons_of(values)
        if not np.array_equal(horizons, self._horizons):
            self._horizons = horizons
            self._writers = Writers(self._live, self._stream, horizons)
            if self._active:
                self._outputs.describe(self._live, self._stream, horizons)

    def _on_joint_states(self, message):
        if not self._active:
            return
        started = perf_counter()
        newest = None
        for _ in range(MOST_AT_ONCE):
            newest = self._take_in(message) or newest
            taken = self._subscription.handle.take_message(JointState, True)
            if taken is None:
                break
            message = taken[0]
        if newest is not None:
            self._answer(newest, started)
        tally = self._stream.tally
        tally.time('callback', perf_counter() - started)
        self._last_message = perf_counter()
        if self._last_message - started > self._values['deadline']:
            tally.count('missed deadlines')
        if self._report_due:
            self._report()

    def _take_in(self, message):
        """The newest step that a serialised joint state leads to, or None."""
        try:
            stamp, names, positions = self._reader.read(message)
        except MotionError:
            self._stream.tally.count('unreadable')
            return None
        steps = self._stream.receive(names, positions, stamp, self._now())
        return steps[-1] if steps else None

    def _answer(self, step, now):
        rate = self._values['max_publish_rate']
        if rate:
            if now < self._next_publication:
                self._stream.tally.count('skipped')
                return
            self._next_publication = max(self._next_publication + 1 / rate, now)
        self._outlook = self._outputs.publish(self._writers, step, lambda: self._stream.predict(self._horizons))

    def _now(self):
        return self.get_clock().handle.get_now().nanoseconds  # without the objects that now() makes

    def _on_report_due(self):
        """Report after the next message, when the one after it is not due yet; at once where none come."""
        self._report_due = True
        if perf_counter() - self._last_message > SILENCE:
            self._report()

    def _report(self):
        self._report_due = False
        name = f'{self.get_name()}: motion prediction'
        if self._active:
            self._warn_once()
            health = health_of(self._stream, self._now(), self._outlook)
        else:
            health = Health(WARN, 'not active', {})
        self._diagnostics.publish(diagnostics_message(self, name, health, self._live.name))

    def _warn_once(self):
        counts = self._stream.tally.total
        told = {
            'zero': 'joint states have zero stamps: the time of arrival is used instead',
            'stale': 'joint states are older than max_stamp_age on arrival and are dropped; a bag played back wants '
                     'use_sim_time with its clock, or max_stamp_age 0',
            'future': 'joint states have stamps in the future and are dropped: are the clocks synchronised?'}
        for what in set(told) - self._warned:
            if counts[what]:
                self._warned.add(what)
                self.get_logger().warning(told[what])
        unknown = [name for name in self._stream.unknown if ('unknown', name) not in self._warned]
        if unknown:
            self._warned.update(('unknown', name) for name in unknown)
            self.get_logger().warning(f'joints that the model does not know are ignored: {" ".join(unknown)}')

    def _on_set_mask(self, request, response):
        try:
            self._stream.set_mask(list(request.joints), not request.masked)
            response.success = True
        except MotionError as error:
            response.message = str(error)
        response.masked_joints = [
            name for name, allowed in zip(self._stream.robot_joints, self._stream.allowed) if not allowed]
        return response

    def _on_reset(self, request, response):
        self._stream.reset()
        self._outlook = None
        response.success = True
        return response

    async def _on_load_model(self, request, response):
        try:
            horizons, loaded = await self._loader.load(request.path)
            if self._stream is None or horizons is not self._horizons:
                raise UsageError('the node was reconfigured meanwhile: the model is not taken over')
            self._take_over(*loaded)
            response.success = True
        except (ModelError, MotionError, UsageError, OSError) as error:
            response.message = str(error)
        if self._stream is not None:
            response.model, response.kind = self._live.name, self._live.kind
            response.joint_names = list(self._live.predictor.joint_names)
        return response

    def _load(self, path):
        """Horizons, and what is built for them; in a thread."""
        horizons = self._horizons
        return horizons, self._build(path, horizons)

    def _take_over(self, live, stream, writers):
        old = self._stream
        masked = [name for name, allowed in zip(old.robot_joints, old.allowed)
                  if not allowed and name in stream.robot_joints]
        if masked:
            stream.set_mask(masked, False)
        stream.configure(settings_of(self._values))
        live.forget(self._values['forgetting'])
        stream.tally = old.tally
        self._live, self._stream, self._writers, self._outlook = live, stream, writers, None
        if self._active:
            self._outputs.describe(live, stream, self._horizons)
        self.get_logger().info(f'now using {live.name}')


def main(args=None):
    """Run the node until it is told to stop."""
    return run(PredictorNode, 'predictor', args=args)


if __name__ == '__main__':
    sys.exit(main())
