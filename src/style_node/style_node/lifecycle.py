"""A lifecycle node that says why a transition failed and survives a transition that makes no sense."""
import traceback

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from style_core.errors import ModelError, MotionError, UsageError

__all__ = ['SoundLifecycleNode', 'transition']


def transition(method):
    """Wrap a transition callback: what a user can mend is a failure with the reason, anything else an error."""
    def run(self, state):
        try:
            return method(self, state)
        except (ModelError, MotionError, UsageError, OSError) as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception:  # rclpy would swallow it without a word
            if self.context.ok():  # nothing can be made while the program is being ended
                self.get_logger().error(traceback.format_exc())
            return TransitionCallbackReturn.ERROR
    run.__doc__ = method.__doc__
    return run


class SoundLifecycleNode(LifecycleNode):
    """Humble's LifecycleNode, but a request for an impossible transition is answered with no, not with an exception."""

    def __init__(self, name, **options):
        super().__init__(name, **options)
        change = self._service_change_state.callback

        def answer(request, response):
            try:
                return change(request, response)
            except rclpy_implementation.RCLError:
                wanted = request.transition.label or request.transition.id
                self.get_logger().warning(f'no transition {wanted} from state {self.state}')
                response.success = False
                return response
        self._service_change_state.callback = answer

    @transition
    def on_cleanup(self, state):
        """Give back everything that configuring made; a node says how in ``_tear_down``."""
        self._tear_down()
        return TransitionCallbackReturn.SUCCESS

    @transition
    def on_shutdown(self, state):
        """The same on the way out."""
        self._tear_down()
        return TransitionCallbackReturn.SUCCESS

    @transition
    def on_error(self, state):
        """The same after an unforeseen error, so that the node can be configured again."""
        self._tear_down()
        return TransitionCallbackReturn.SUCCESS

    @property
    def state(self):
        """Label of the current state."""
        return self._state_machine.current_state[1]
