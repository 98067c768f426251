"""What the synthesizer hears: topics of sequences, styles and estimates, handed to the stage as arrays."""
from dataclasses import dataclass

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy

from style_core.errors import ModelError, MotionError, UsageError
from style_core.stream.stamp_policy import NANOSECONDS
from style_core.synthesis.repertoire import Score
from style_msgs.msg import StateSequence, StyleEstimate, StyleVector
from style_node.message_reading import reader_of
from style_node.qos import overrides

__all__ = ['Inputs', 'score_of']

ESTIMATE_QOS = QoSProfile(depth=8, reliability=ReliabilityPolicy.BEST_EFFORT)
#: an estimate older than this is not carried further forward, s
OLDEST_S = 0.2
#: a stamp by more than this earlier than the one before is a clock set back, not an estimate overtaken by another, ns
SET_BACK = NANOSECONDS
#: what is used of an estimate
ESTIMATE_FIELDS = ('header', 'model', 'status', 'discrete', 'phase', 'phase_velocity', 'style', 'behaviours',
                   'behaviour_probabilities')


def score_of(message):
    """The Score of a StateSequence; None where the message is empty."""
    if len(message.occupancy) or message.n_states:
        count = max(int(message.n_states), 1)
        flat = np.array(message.occupancy, dtype=float)
        rows = flat.reshape(-1, count) if len(flat) % count == 0 else flat[None, :]
        return Score(tuple(message.states), tuple(message.dwell_times), rows, float(message.step))
    if len(message.states) or len(message.dwell_times):
        return Score(tuple(int(state) for state in message.states), tuple(message.dwell_times))
    return None


@dataclass(frozen=True, eq=False)
class Person:
    """What an estimate says of a person, as `Stage.observe` takes it, and its stamp in ns."""

    phase: float
    velocity: float
    behaviour: str
    style: object
    age: float
    stamp: int


def person_of(message, model, now):
    """The Person of a StyleEstimate that ``model`` can follow at ``now`` (ns), or None."""
    if message.status != StyleEstimate.TRACKING or message.discrete:
        return None
    likely = message.behaviour_probabilities
    known = len(likely) == len(message.behaviours) > 0
    behaviour = message.behaviours[int(np.argmax(likely))] if known else ''
    stamp = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
    age = min(max((now - stamp) / NANOSECONDS, 0.0), OLDEST_S) if stamp else 0.0
    return Person(message.phase, message.phase_velocity, behaviour, message.style if message.model == model else None,
                  age, stamp)


class Inputs:
    """The synthesizer's subscriptions: serialised messages, which a checked reader takes apart.

    Parameters
    ----------
    node : SynthesizerNode
    """

    def __init__(self, node):
        self._node = node
        self._newest = 0    # stamp of the newest estimate, ns
        self._heard = [
            node.create_subscription(kind, topic, self._reading(reader_of(kind, what, wanted), what, take), qos,
                                     raw=True, qos_overriding_options=overrides())
            for kind, topic, what, take, qos, wanted in (
                (StateSequence, '~/sequence', 'sequence', self._on_sequence, 5, None),
                (StyleVector, '~/style', 'style', self._on_style, 5, None),
                (StyleEstimate, 'estimate', 'estimate', self._on_estimate, ESTIMATE_QOS, ESTIMATE_FIELDS))]

    def destroy(self):
        """Take the subscriptions down."""
        for one in self._heard:
            self._node.destroy_subscription(one)

    def _reading(self, reader, what, take):
        """A callback that reads a serialised message and hands it on; nothing while the node is not active."""
        def callback(data):
            if not self._node.active:
                return
            try:
                message = reader.read(data)
            except MotionError as error:
                self._refused(what, error)
            else:
                take(message)
        return callback

    def _refused(self, what, error):
        self._node.tally.count(f'{what} refused')
        self._node.get_logger().warning(f'{what} refused: {error}', throttle_duration_sec=1.0)

    def _on_sequence(self, message):
        try:
            score = score_of(message)
            if score is None:
                raise UsageError('it is empty')
            self._node.choose('sequence', score=score)
        except (UsageError, ModelError) as error:
            self._refused('sequence', error)

    def _on_style(self, message):
        try:
            self._node.stage.set_style(message.name if not len(message.values) else message.values)
        except UsageError as error:
            self._refused('style', error)

    def _on_estimate(self, message):
        node = self._node
        person = person_of(message, node.stage.repertoire.name, node.now())
        if person is None:
            node.tally.count('estimates not followed')
            return
        if person.stamp and 0 <= self._newest - person.stamp < SET_BACK:
            node.tally.count('estimates overtaken')
            return
        self._newest = person.stamp
        try:
            node.pass_time()
            if node.stage.observe(person.phase, person.velocity, person.behaviour, person.style, person.age):
                node.publish()
            else:
                node.tally.count('estimates not followed')
        except UsageError as error:
            self._refused('estimate', error)
