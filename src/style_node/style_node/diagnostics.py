"""What a node says of itself on /diagnostics."""
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from style_core.budgets import FACT_TEXT, FACTS_TEXT
from style_core.stream.health import ERROR
from style_core.text import shown

__all__ = ['diagnostics_message']


def diagnostics_message(node, name, health, hardware=''):
    """DiagnosticArray with one status of bounded size, stamped by the node's clock.

    Exceptions of the node's callbacks are added to what ``health`` says.
    """
    level, summary, facts = health.level, health.summary, dict(health.facts)
    failures = getattr(node.executor, 'failures', None)
    if failures is not None and failures.total:
        facts['callbacks failed'] = str(failures.total)
        facts['callback failed last'] = failures.newest
        if fresh := failures.fresh():
            level, summary = ERROR, f'{fresh} callbacks failed, last {failures.newest}; {summary}'
    status = DiagnosticStatus(level=bytes([level]), name=shown(name, FACT_TEXT), message=shown(summary, FACT_TEXT),
                              hardware_id=shown(hardware, FACT_TEXT), values=list(_bounded(facts)))
    message = DiagnosticArray(status=[status])
    message.header.stamp = node.get_clock().now().to_msg()
    return message


def _bounded(facts):
    room = FACTS_TEXT
    for key, value in facts.items():
        pair = KeyValue(key=shown(key, FACT_TEXT), value=shown(value, FACT_TEXT))
        room -= len(pair.key) + len(pair.value)
        if room < 0:
            yield KeyValue(key='left out', value='more than a report has room for')
            return
        yield pair
