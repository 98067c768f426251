"""Load models in threads, so that neither messages nor the end of the program wait for a file."""
import threading

from rclpy.task import Future

from style_core.budgets import HANGING_LOADS, PATH_BYTES
from style_core.errors import UsageError

__all__ = ['Loader']


class Loader:
    """Loads one thing at a time; a newer request takes the place of one that has not ended.

    A thread cannot be stopped: one that hangs is left behind, and its outcome ignored.

    Parameters
    ----------
    node : rclpy.node.Node
    load : callable
        Called with a path in a thread.
    """

    def __init__(self, node, load):
        self._node, self._load = node, load
        self._lock, self._threads, self._newest = threading.Lock(), [], None

    async def load(self, path):
        """What ``load(path)`` returns; raises what it raises.

        Raises
        ------
        UsageError
            Where the path is none, a newer request has come meanwhile, or too many loads hang.
        """
        if not path or '\0' in path or len(path.encode(errors='replace')) > PATH_BYTES:
            raise UsageError(f'give the path of a model file, of {PATH_BYTES} bytes at most')
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        if len(self._threads) > HANGING_LOADS:
            raise UsageError(f'{len(self._threads)} loads have not ended yet: wait, or start the node anew')
        done, before = Future(executor=self._node.executor), self._newest
        self._newest = done
        if before is not None:
            self._finish(before, UsageError('given up: another model was asked for meanwhile'))
        thread = threading.Thread(target=self._run, args=(path, done), name='load', daemon=True)
        self._threads.append(thread)
        thread.start()
        outcome = await done
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    def _run(self, path, done):
        try:
            self._finish(done, self._load(path))
        except Exception as error:  # whatever it is, whoever asked must hear of it
            self._finish(done, error)

    def _finish(self, done, outcome):
        with self._lock:
            if not done.done() and self._node.context.ok():
                done.set_result(outcome)
