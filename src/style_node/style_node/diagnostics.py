"""What a node says of itself on /diagnostics."""
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

__all__ = ['diagnostics_message']


def diagnostics_message(stamp, name, health, hardware=''):
    """DiagnosticArray with one status."""
    status = DiagnosticStatus(level=bytes([health.level]), name=name, message=health.summary, hardware_id=hardware,
                              values=[KeyValue(key=key, value=value) for key, value in health.facts.items()])
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message
