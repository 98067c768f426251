"""What joints are commanded while the bridge is stopped: they stand, but press with no more than they may."""
import numpy as np

__all__ = ['Holding']


class Holding:
    """The posture to hold, which gives way where a joint stays away from it.

    A position servo pushes the harder the further its joint is from the command. So the command of a stopped joint is
    kept within ``press`` of where the joint is: once the command stands and the joint has been further away for
    ``patience``, the command comes back to that distance, follows the joint, and stays where it went.

    Parameters
    ----------
    press : ndarray, shape (D,)
        Rad.
    patience : float
        A joint may be further away for this long, s: it catches up after braking.
    """

    def __init__(self, press, patience):
        self._press, self._patience = press, patience
        self._since = np.full(len(press), np.nan)
        self._goal = None
        self._yielding = None

    def start(self, yielding=None):
        """Begin anew with the next reference; joints of the mask ``yielding`` hold where they are, without pressing."""
        self._goal, self._yielding = None, yielding
        self._since[:] = np.nan

    def reference(self, now, command, standing, measured):
        """Posture to hold (shape (D,), rad), or None while the joints are to brake.

        Parameters
        ----------
        now : float
            S.
        command, measured : ndarray, shape (D,)
            Rad; NaN where a joint is not known.
        standing : bool
            Whether the command stands.
        """
        if self._goal is None:
            if not standing:
                return None
            self._goal = command.copy()
            if self._yielding is not None:
                self._goal = np.where(self._yielding & np.isfinite(measured), measured, command)
        error = self._goal - measured
        beyond = np.abs(error) > self._press        # false for NaN
        self._since = np.where(beyond, np.where(np.isnan(self._since), now, self._since), np.nan)
        due = now - self._since >= self._patience
        if due.any():
            edge = measured + np.clip(error, -self._press, self._press)
            self._goal = np.where(due, edge, self._goal)
        return self._goal
