"""The emergency stop's topics, heard whatever quality of service their publishers offer."""
import time
from functools import partial

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_event import SubscriptionEventCallbacks
from std_msgs.msg import Bool

from style_servo.emergency_stop import BEST_EFFORT, LATCHED, RELIABLE

__all__ = ['EstopTopics']

DEPTH = 100
_LATCHED, _VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
# a subscription hears who offers at least what it asks for: the first hears what was said before it was made, the last
# hears everybody
STREAMS = {LATCHED: (ReliabilityPolicy.RELIABLE, _LATCHED), RELIABLE: (ReliabilityPolicy.RELIABLE, _VOLATILE),
           BEST_EFFORT: (ReliabilityPolicy.BEST_EFFORT, _VOLATILE)}
SETTLE_S = 0.5      # until publishers on the same network have found a new subscription
FIRST_WORD_S = 3.0      # how long activation waits for a topic that must be heard
LOOK_S = 0.01


class EstopTopics:
    """Subscriptions that keep an EmergencyStop up to date for as long as the node lives.

    Parameters
    ----------
    node : rclpy.node.Node
    stop : EmergencyStop
        Its topics are names as the node's publishers would use them.
    changed : callable
        Called without arguments after a message that pressed.
    """

    def __init__(self, node, stop, changed):
        self._node, self._stop, self._changed = node, stop, changed
        self._made_at = time.monotonic()
        self._streams = []
        # a publisher that the first two subscriptions do not fit is heard by the third: no reason for a warning
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        for button in stop.buttons:
            button.topic = node.resolve_topic_name(button.topic)
            for stream, (reliability, durability) in STREAMS.items():
                hear = partial(self._hear, button, stream)
                self._streams.append((node.create_subscription(
                    Bool, button.topic, hear, QoSProfile(depth=DEPTH, reliability=reliability, durability=durability),
                    event_callbacks=quiet), hear))

    def _hear(self, button, stream, message):
        button.hear(message.data, stream, time.monotonic(), partial(self._publishers, button.topic))
        if message.data:
            self._changed()

    def _publishers(self, topic):
        offers = []
        for one in self._node.get_publishers_info_by_topic(topic):
            profile = one.qos_profile
            reliable = profile.reliability == ReliabilityPolicy.RELIABLE
            offers.append(BEST_EFFORT if not reliable else
                          LATCHED if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL else RELIABLE)
        return offers

    def catch_up(self):
        """Hear what has arrived but was not handed over yet; in the executor's thread."""
        for subscription, hear in self._streams:
            with subscription.handle:
                for _ in range(DEPTH):
                    taken = subscription.handle.take_message(Bool, False)
                    if taken is None:
                        break
                    hear(taken[0])

    def settle(self):
        """Wait until everybody who has something to say could have said it (bounded), before torque comes on."""
        begin = time.monotonic()
        self.catch_up()
        while time.monotonic() < self._made_at + SETTLE_S or (
                self._stop.required and not self._stop.known and time.monotonic() < begin + FIRST_WORD_S):
            time.sleep(LOOK_S)
            self.catch_up()

    def override(self):
        """Release on the operator's word; see EmergencyStop.override."""
        self.catch_up()
        self._stop.override(self._node.count_publishers)
