"""How a running stream is doing, in words and numbers for diagnostics."""
from dataclasses import dataclass
from typing import Mapping

import numpy as np

from style_core.predictor import Status

__all__ = ['OK', 'WARN', 'ERROR', 'Health', 'health_of']

OK, WARN, ERROR = 0, 1, 2

#: reasons for which a message or a value is not used
REJECTIONS = ('unreadable', 'wrong length', 'no positions', 'duplicate names', 'no known joint', 'stale', 'future',
              'jump', 'out of order', 'late', 'NaN values', 'implausible values', 'values not believed',
              'filter failures')


@dataclass(frozen=True)
class Health:
    """One report.

    Attributes
    ----------
    level : int
        `OK`, `WARN` or `ERROR`.
    summary : str
        One line.
    facts : mapping of str to str
    """

    level: int
    summary: str
    facts: Mapping[str, str]


def health_of(stream, now, outlook=None):
    """Report on a stream since the last report.

    Parameters
    ----------
    stream : PredictorStream
    now : int
        Ns, on the clock of the stamps.
    outlook : Outlook, optional
        The last prediction, for "how sure".

    Returns
    -------
    Health
    """
    tally = stream.tally
    fresh = tally.fresh()
    sensors = stream.sensors(now)
    status = stream.status()
    rejected = {reason: fresh[reason] for reason in REJECTIONS if fresh[reason]}
    unusable = sensors['timed out'] + sensors['never seen'] + sensors['not measured']
    facts = {'status': status.name, 'messages in the last report': str(fresh['messages']),
             'updates in the last report': str(fresh['updates'])}
    if stream.last is not None:
        estimate = stream.last.estimate
        facts['stamp age (s)'] = f'{(now - stream.last.stamp) * 1e-9:.4f}'
        facts['phase'] = f'{estimate.phase:.3f}'
        facts['phase standard deviation'] = f'{np.sqrt(max(estimate.phase_covariance[0, 0], 0)):.3f}'
        facts['innovation (about 1 while the model fits)'] = f'{estimate.innovation:.2f}'
        facts.update({f'probability of {name}': f'{value:.3f}' for name, value in estimate.behaviours.items()})
    if outlook is not None:
        width = np.degrees(1.645 * outlook.std).mean(axis=1)
        facts['90 % band, mean half width (deg), nearest and farthest'] = f'{width[0]:.2f}, {width[-1]:.2f}'
    for what in ('update', 'predict', 'callback'):
        median, high = tally.percentiles(what)
        if np.isfinite(median):
            facts[f'{what} time p50, p99 (ms)'] = f'{1e3 * median:.3f}, {1e3 * high:.3f}'
    facts['missed deadlines'] = str(tally.total['missed deadlines'])
    facts['predictions skipped'] = str(tally.total['skipped'])
    facts.update({f'joints {state}': ' '.join(names) or 'none' for state, names in sensors.items() if state != 'used'})
    facts['joints used'] = str(len(sensors['used']))
    facts['unknown joints'] = ' '.join(stream.unknown) or 'none'
    facts['clock resets'] = str(tally.total['clock resets'])
    facts['zero stamps'] = str(tally.total['zero'])
    facts.update({f'rejected: {reason}': str(tally.total[reason]) for reason in REJECTIONS})
    return Health(*_judge(status, fresh, rejected, unusable, sensors), facts)


def _judge(status, fresh, rejected, unusable, sensors):
    if not fresh['messages']:
        return ERROR, 'no joint states arrive'
    if not fresh['updates']:
        return ERROR, 'no joint states can be used: ' + _listed(rejected)
    if status == Status.LOST:
        return ERROR, 'lost: the model does not explain what the joints do'
    troubles = []
    if status == Status.UNKNOWN:
        troubles.append('motion that no model knows: predicted by short-range dynamics')
    if status == Status.ACQUIRING:
        troubles.append('searching for the phase')
    if unusable:
        troubles.append(f'{len(unusable)} of {sum(map(len, sensors.values()))} joints missing')
    if rejected:
        troubles.append('rejected: ' + _listed(rejected))
    if fresh['missed deadlines']:
        troubles.append(f'{fresh["missed deadlines"]} deadlines missed')
    return (WARN, ', '.join(troubles)) if troubles else (OK, 'tracking')


def _listed(rejected):
    return ', '.join(f'{count} {reason}' for reason, count in rejected.items()) or 'nothing'
