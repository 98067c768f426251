"""The bridge in words and numbers for diagnostics."""
import math
from collections import deque

import numpy as np

from style_core.stream.health import ERROR, OK, WARN, Health
from style_servo.states import State

__all__ = ['CycleTimes', 'health_of_bridge', 'with_the_rest']

OFF_S = 0.001       # a period further than this from what it should be is counted


class CycleTimes:
    """Durations of the bridge's cycles and errors of their period, since the last report and in total."""

    def __init__(self, period):
        self.period = period
        self.cycles = self.missed = self.skipped = self.late = self.off = 0
        self.last = 0.0
        self._previous = None
        self._recent = deque(maxlen=100000)     # (duration, error): filled by one thread, emptied by another

    def done(self, now, periods, duration):
        """Count a cycle: its beginning (s), the periods it made up for (0: left out), and what it took (s)."""
        if not periods:
            self.skipped += 1
            return
        error = math.nan if self._previous is None else abs(now - self._previous - self.period)
        self.off += error > OFF_S
        self._previous = now
        self.cycles += 1
        self.late += periods - 1
        self.last = duration
        self._recent.append((duration, error))
        if duration > self.period:
            self.missed += 1

    def report(self):
        """Facts since the last report, as text by name."""
        facts, recent = {}, np.array([self._recent.popleft() for _ in range(len(self._recent))]).reshape(-1, 2)
        for name, values in zip(('cycle time', 'period error'), recent.T):
            values = values[~np.isnan(values)]
            if len(values):
                median, high = 1e3 * np.percentile(values, [50, 99])
                facts[f'{name} p50, p99, max (ms)'] = f'{median:.3f}, {high:.3f}, {1e3 * np.max(values):.3f}'
        return facts


def health_of_bridge(bridge, times, flood, now):
    """Report on the bridge: level, one line, and facts.

    Parameters
    ----------
    bridge : Bridge
    times : CycleTimes
    flood : int
        Messages dropped because too many came in one cycle.
    now : float
        S, on the bridge's clock.
    """
    measurement, backend = bridge.backend.measurement, bridge.backend
    facts = {'state': bridge.state.name, 'reason': bridge.reason or 'none', **times.report(),
             'input age (s)': f'{bridge.input_age(now):.3f}', 'cycles': str(times.cycles),
             'missed deadlines': str(times.missed), 'periods off by more than 1 ms': str(times.off),
             'periods made up for': str(times.late),
             'cycles left out': str(times.skipped),
             'trajectories accepted': str(bridge.counts['accepted']),
             'trajectories rejected': str(bridge.counts['rejected']),
             'messages dropped in floods': str(flood),
             'joint commands clamped': str(bridge.counts['clamped']),
             'joint targets rejected': str(bridge.counts['limiter rejections'])}
    lag = bridge.take_lag()
    if lag is not None:
        facts['largest lag behind the trajectory (rad)'] = f'{lag[1]:.4f} ({lag[0]})'
    facts.update({f'rejected: {kind}': str(count) for kind, count in dict(bridge.rejections).items()})
    facts.update({f'bus: {name}': str(count) for name, count in backend.statistics.items()})
    if np.any(np.isfinite(bridge.command)):
        error = np.abs(bridge.command - measurement.position)
        if np.any(np.isfinite(error)):
            worst = int(np.nanargmax(error))
            facts['largest following error (rad)'] = f'{error[worst]:.4f} ({bridge.chain.names[worst]})'
    for i, name in enumerate(bridge.chain.names):
        if np.isfinite(measurement.temperature[i]):
            facts[f'{name}: temperature (deg C), voltage (V), effort'] = (
                f'{measurement.temperature[i]:.0f}, {measurement.voltage[i]:.1f}, {measurement.effort[i]:.3f}')
    facts.update(backend.facts)
    facts.update({f'note {k + 1}': note for k, note in enumerate(backend.notes)})
    warnings = backend.warnings
    facts.update({f'warning {k + 1}': warning for k, warning in enumerate(warnings)})
    state = bridge.state
    if state in (State.FAULT, State.ESTOP):
        return Health(ERROR, f'{state.name}: {bridge.reason}', facts)
    if state in (State.HOLDING, State.RELAXED):
        return Health(WARN, f'{state.name}: {bridge.reason}', facts)
    if not measurement.fresh and state.armed:
        return Health(WARN, f'{state.name}, but the last bus cycle brought no answer', facts)
    if lag is not None and state in (State.RAMPING, State.STREAMING):
        return Health(WARN, f'{state.name}, but {lag[0]} lags {lag[1]:.2f} rad behind: the trajectory asks for more '
                            'than its limits', facts)
    if warnings:
        return Health(WARN, f'{state.name}, but {warnings[0]}', facts)
    return Health(OK, state.name, facts)


def with_the_rest(health, bridge, pressed, recorder, mishaps, last_mishap):
    """The same with what is of the node and not of the bridge's cycles.

    Parameters
    ----------
    health : Health
    bridge : Bridge
    pressed : str
        Why the emergency stop counts as pressed, or ''.
    recorder : Recorder or None
    mishaps : int
        Exceptions of callbacks, and ``last_mishap`` the last one in words.
    """
    facts = {**health.facts, 'emergency stop': pressed or 'released',
             'errors of the program': str(mishaps + bridge.counts['internal errors'])}
    if last_mishap:
        facts['last error of the program'] = last_mishap
    facts.update({f'rejected: {kind}': str(count) for kind, count in dict(bridge.rejections).items()})
    level, summary = health.level, health.summary
    if recorder is not None:
        facts['flight record'] = recorder.problem or 'written'
        facts['flight record: cycles left out'] = str(recorder.lost)
        if recorder.problem and level == OK:
            level, summary = WARN, f'{summary}, but the flight record has ended: {recorder.problem}'
    return Health(level, summary, facts)
