"""Stream the trajectory of a robot from a model and a style: the synthesizer as a lifecycle node."""
import gc
import sys
from pathlib import Path
from time import perf_counter

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import TransitionCallbackReturn

from style_core.errors import ModelError, MotionError, UsageError
from style_core.places import find_file, shipped_folder
from style_core.stream.health import WARN, Health
from style_core.stream.stamp_policy import NANOSECONDS
from style_core.stream.tally import Tally
from style_core.synthesis.health import synthesis_health
from style_core.synthesis.repertoire import list_models, load_repertoire
from style_core.synthesis.retargeting import plain_robot, read_robot
from style_core.synthesis.stage import Stage
from style_node.diagnostics import diagnostics_message
from style_node.executor import run
from style_node.lifecycle import SoundLifecycleNode, transition
from style_node.ros_parameters import declare, values_of, watch
from style_synth.action import SynthesizeServer
from style_synth.inputs import Inputs
from style_synth.outputs import Outputs, status_message
from style_synth.parameters import SYNTHESIZER, options_of, settings_of, window_of
from style_synth.services import Services

__all__ = ['SynthesizerNode', 'main']

STATUS_EVERY_S = 0.2
#: a longer pause between two ticks is not made up for, s
LONGEST_TICK_S = 0.2


class SynthesizerNode(SoundLifecycleNode):
    """See ``docs/synthesizer.md`` for topics, services, the action and parameters."""

    def __init__(self, **options):
        super().__init__('synthesizer', **options)
        self.stage = None
        self.active = False
        declare(self, SYNTHESIZER)
        watch(self, SYNTHESIZER, lambda: self.stage is not None, self._apply)
        # as long as the node: who has asked for a motion gets its result also where the node is cleaned up meanwhile
        self._action = SynthesizeServer(self)

    # --- lifecycle ----------------------------------------------------------------------------------------------

    @transition
    def on_configure(self, state):
        """Load model, recording and robot; make the interfaces."""
        self._values = values = values_of(self, SYNTHESIZER)
        self._ahead = window_of(values)
        self.step = values['step']
        robot = read_robot(find_file(values['robot'], 'robot')) if values['robot'] else plain_robot()
        stage = Stage(self._load(values['model']), robot, settings_of(values))
        stage.style_text = values['style']
        stage.choose(values['mode'], **options_of(values, values['mode']))
        if values['style'] and stage.source is not None:
            stage.style_for(stage.source, values['style'])   # says what is wrong with it
        stage.window(self._ahead)   # warm
        self.stage = stage
        self.tally = Tally()
        self._outputs = Outputs(self, stage.joint_names, self._ahead)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._inputs, self._offered = Inputs(self), Services(self, self._load)
        self._timers_made = [self.create_timer(1.0 / values['rate'], self._tick),
                             self.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))]
        self._told, self._status_due, self._at_rest = None, 0.0, False
        gc.collect()
        gc.freeze()     # what is loaded now stays; the collector need not look at it again while estimates wait
        self.get_logger().info(f'configured with {stage.repertoire.name or "a recording"} for {robot.name}: '
                               f'{len(stage.joint_names)} joints, mode {stage.mode}')
        return TransitionCallbackReturn.SUCCESS

    @transition
    def on_activate(self, state):
        """Stream from now on."""
        result = super().on_activate(state)
        self._clock_was = self._published = self.now()
        self.active = True
        self.describe()
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
        self._action.give_up()
        self.stage = None
        self._inputs.destroy()
        self._offered.destroy()
        for one in self._timers_made:
            self.destroy_timer(one)
        self.destroy_publisher(self._diagnostics)
        self._outputs.destroy()

    # --- files --------------------------------------------------------------------------------------------------

    def _models_folder(self):
        return self._values['models_folder'] or shipped_folder('model') or Path.cwd()

    def _load(self, model):
        values = self._values
        return load_repertoire(find_file(model, 'model', values['models_folder']) if model else '', values['file'],
                               values['skeleton'])

    def describe(self):
        """Publish the latched lists anew; nothing while not active."""
        if self.active:
            self._outputs.describe(self.stage.repertoire, list_models(self._models_folder()), self.stage.source,
                                   self.stage.joint_names)

    # --- what to perform ----------------------------------------------------------------------------------------

    def choose(self, mode, **more):
        """Go over to a mode, with the options that the parameters give it."""
        self.stage.choose(mode, **options_of(self._values, mode), **more)

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
                self.describe()
            elif values['speed'] != old['speed'] and stage.source is not None:
                stage.source.set_speed(values['speed'], values['transition_time'])
        except (ModelError, MotionError) as error:
            raise UsageError(str(error)) from None
        self._values = values

    # --- time and output ----------------------------------------------------------------------------------------

    def now(self):
        """Clock, ns."""
        return self.get_clock().now().nanoseconds

    def stamp(self):
        """Now, as a message."""
        return self.get_clock().now().to_msg()

    def pass_time(self):
        """Bring everything to the present."""
        now = self.now()
        dt = min(max((now - self._clock_was) / NANOSECONDS, 0.0), LONGEST_TICK_S)
        self._clock_was = now
        self._action.work(dt)
        self.stage.advance(dt)

    def _tick(self):
        if not self.active:
            return
        self.pass_time()
        # estimates are answered at once; the timer only fills their silence
        following = self.stage.mode == 'follow' and \
            0 <= self._clock_was - self._published < 1.5 * NANOSECONDS / self._values['rate']
        if not following:       # nor has the clock been set back
            self.publish()
        standing = self.stage.standing()
        if (standing.state, standing.message) != self._told or perf_counter() >= self._status_due:
            self._told, self._status_due = (standing.state, standing.message), perf_counter() + STATUS_EVERY_S
            source = None if self.stage.performer is None else self.stage.performer.source
            self._outputs.status(status_message(standing, source, self.stage.repertoire.name, self.stamp()))

    def publish(self):
        """Publish a window that begins now."""
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
        self.tally.time('window', perf_counter() - started)
        self.tally.count('windows')
        if perf_counter() - started > self._values['deadline']:
            self.tally.count('missed deadlines')

    def _report(self):
        health = synthesis_health(self.stage, self.tally) if self.active else Health(WARN, 'not active', {})
        self._diagnostics.publish(diagnostics_message(self, f'{self.get_name()}: motion synthesis', health,
                                                      self.stage.repertoire.name))


def main(args=None):
    """Run the node until it is told to stop."""
    return run(SynthesizerNode, 'synthesizer', args=args)


if __name__ == '__main__':
    sys.exit(main())
