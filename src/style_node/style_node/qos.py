"""Quality of service that a user may change by parameters."""
from rclpy.qos import QoSPolicyKind
from rclpy.qos_overriding_options import QoSOverridingOptions

__all__ = ['OVERRIDABLE', 'overrides']

#: what ``qos_overrides.<topic>.subscription.<policy>`` may be
OVERRIDABLE = 'history', 'depth', 'reliability', 'durability'


def overrides():
    """Options of a subscription whose policies in `OVERRIDABLE` are parameters of the node."""
    return QoSOverridingOptions([QoSPolicyKind[name.upper()] for name in OVERRIDABLE])
