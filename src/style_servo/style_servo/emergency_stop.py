"""Whether the emergency stop is pressed: a state that outlives messages, publishers and the node's life cycle."""
import math

from style_core.errors import UsageError

__all__ = ['Button', 'EmergencyStop', 'LATCHED', 'RELIABLE', 'BEST_EFFORT']

#: The streams by which a topic is heard, strongest first. A publisher reaches its own and every weaker one.
LATCHED, RELIABLE, BEST_EFFORT = 'reliable and transient local', 'reliable', 'best effort'


class Button:
    """What one topic says.

    Whoever says `pressed` on any stream presses. Whether a `released` releases depends on who is there:

    * From the topic's only publisher it does, on the strongest stream that this publisher reaches: there nothing is
      lost or out of order. On a weaker one it takes back no more than what that stream said.
    * Where several publishers were there while it was pressed, it does not: nobody can tell whose `released` it is.

    Parameters
    ----------
    topic : str
        Name, for people.

    Attributes
    ----------
    pressed : bool
    known : bool
        Whether anything was ever heard.
    heard_at : float
        When the last message came, s; -inf before the first.
    """

    def __init__(self, topic):
        self.topic = topic
        self.pressed = self.known = self.crowded = False
        self.heard_at = -math.inf
        self._said = {}

    def hear(self, pressed, stream, now, publishers):
        """Take a message.

        Parameters
        ----------
        pressed : bool
        stream : str
            LATCHED, RELIABLE or BEST_EFFORT: by which subscription it came.
        now : float
            S.
        publishers : callable
            Returns a list: for every publisher of the topic the strongest stream that it reaches.
        """
        self.heard_at = now
        if pressed:
            self._said[stream] = self.pressed = True
            self.crowded = self.crowded or len(publishers()) > 1
        elif self.pressed:
            self._release(stream, publishers())
        self.known = True

    def _release(self, stream, publishers):
        self.crowded = self.crowded or len(publishers) > 1
        if self.crowded:
            return
        if not publishers or publishers[0] == stream:
            self._said.clear()
        else:
            self._said.pop(stream, None)
        self.pressed = bool(self._said)

    def speaks_for_itself(self, n_publishers):
        """Whether it is pressed and its only publisher is there, which can say when it is released."""
        return self.pressed and n_publishers == 1 and not self.crowded

    def override(self):
        """Take it that the button is released, because the operator says so."""
        self._said.clear()
        self.pressed = self.crowded = False
        self.known = True


class EmergencyStop:
    """All buttons, and the stop by service.

    One thread changes it, any thread may ask.

    Parameters
    ----------
    topics : sequence of str
    required : bool
        A topic of which nothing was ever heard counts as pressed.
    heartbeat : float
        A topic that is silent for longer than this counts as pressed, s; 0: silence means nothing.

    Attributes
    ----------
    buttons : tuple of Button
    by_service : bool
        Stopped by service, until a reset.
    """

    def __init__(self, topics, required=False, heartbeat=0.0):
        self.buttons = tuple(Button(topic) for topic in topics)
        self.required, self.heartbeat = required or heartbeat > 0, heartbeat
        self.by_service = False

    def reason(self, now):
        """Why the emergency stop counts as pressed at time ``now`` (s); '' if it does not."""
        if self.by_service:
            return 'emergency stop by service, until a reset'
        for button in self.buttons:
            if button.pressed:
                return f'emergency stop pressed on {button.topic}' + (
                    ', where several publish: whose release it is cannot be told, so only ~/release_estop releases it'
                    if button.crowded else '')
            if self.required and not button.known:
                return f'emergency stop: nothing was heard on {button.topic}, which counts as pressed'
            # a topic that the operator has overridden is known, but still silent
            if 0 < self.heartbeat < now - button.heard_at:
                return f'emergency stop: {button.topic} has been silent for more than {self.heartbeat:g} s'
        return ''

    @property
    def known(self):
        """Whether something was heard of every button."""
        return all(button.known for button in self.buttons)

    def override(self, count_publishers):
        """Release every button on the operator's word, or none; ``count_publishers`` takes a topic.

        Raises
        ------
        UsageError
            Where a button is pressed and its only publisher is there.
        """
        for button in self.buttons:
            if button.speaks_for_itself(count_publishers(button.topic)):
                raise UsageError(f'{button.topic} is pressed and its publisher is there: release it there')
        for button in self.buttons:
            button.override()
