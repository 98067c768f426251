"""Score and draw what the demo recorded."""
import json

import matplotlib
import numpy as np

from style_core import pictures
from style_core.evaluation import phase_error_percent, windows_clear_of
from style_core.motion import Motion, matching_names
from style_core.phase_style import load_predictor

matplotlib.use('Agg')
import matplotlib.pyplot as plt

__all__ = ['report']

#: horizons shown, s; the nearest predicted ones are taken
SHOWN_S = (1 / 60, 0.1, 0.2, 0.3, 0.4)
#: a prediction this far ahead is drawn, s
DRAWN_S = 0.25
#: the first seconds are the search for the phase
SETTLED_S = 2.0


class Session:
    """What was recorded, as arrays on one clock that starts with the first joint state."""

    def __init__(self, recorder, show):
        truth, positions = recorder.numbers('/motion_player/truth', 'position')
        self.names = tuple(truth.name)
        stamps = recorder.times('/motion_player/truth')[1]
        self.start = stamps[0]
        self.truth = Motion(self.names, positions.reshape(-1, len(self.names)), self._seconds(stamps))
        first, mean, std = recorder.numbers('/predictor/prediction', 'mean.points.positions', 'standard_deviation')
        self.at = self._seconds(recorder.times('/predictor/prediction')[1])
        points = first.mean.points
        self.horizons = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points])
        assert tuple(first.mean.joint_names) == self.names
        self.mean, self.std = (values.reshape(-1, len(points), len(self.names)) for values in (mean, std))
        arrivals, answered = recorder.times('/predictor/trajectory')
        self.latency = (arrivals - answered) * 1e-9
        self.estimates = [message for _, message in recorder.read('/predictor/estimate')]
        self.estimated_at = self._seconds(recorder.times('/predictor/estimate')[1])
        self.sent = len(recorder.times('/joint_states')[0])
        self.seams = np.arange(1, 1000) * (show.motion.duration_s + 1 / show.motion.rate_hz) if show.laps_join else ()

    def _seconds(self, stamps):
        return (stamps - self.start) * 1e-9


def report(recorder, show, dark, method, folder):
    """Print the table, write it as JSON, draw the pictures into ``folder``."""
    session = Session(recorder, show)
    leg = np.isin(session.names, matching_names(session.names, ('lfemur.*', 'ltibia.*', 'lfoot.*', 'ltoes.*')))
    result = _scores(session, dark, leg)
    result['phase_error_percent'] = _phase_errors(session, show, dark, method)
    latency = 1e3 * session.latency[session.at > SETTLED_S] if len(session.latency) == len(session.at) \
        else 1e3 * session.latency
    result['latency_ms'] = {'p50': float(np.percentile(latency, 50)), 'p99': float(np.percentile(latency, 99))}
    result['messages'] = {'sent': session.sent, 'answered': len(session.at)}
    _print(result)
    (folder / 'demo.json').write_text(json.dumps(result, indent=1) + '\n')
    pictures.save(_curves(session, dark), folder / 'joints.png')
    pictures.save(_course(session, dark), folder / 'phase_and_style.png')
    pictures.save(_figures(session, show, dark), folder / 'poses.png')


def _scores(session, dark, leg):
    """RMS errors in degrees by horizon, before and during the loss."""
    shown = [int(np.argmin(np.abs(session.horizons - wanted))) for wanted in SHOWN_S]
    clear = windows_clear_of(session.at, session.horizons, session.seams)
    clear &= session.at + session.horizons[-1] <= session.truth.times[-1]
    parts = {'before': clear & (session.at > SETTLED_S) & (session.at + session.horizons[-1] < dark[0]),
             'during': clear & (session.at >= dark[0] + 0.1) & (session.at < dark[1])}
    result = {'horizons_s': session.horizons[shown].tolist()}
    for part, rows in parts.items():
        present = session.truth.at(session.at[rows]).positions
        future = np.stack([session.truth.at(session.at[rows] + ahead).positions
                           for ahead in session.horizons[shown]], axis=1)
        error = np.degrees(session.mean[rows][:, shown] - future)
        still = np.degrees(present[:, None] - future)
        inside = np.abs(error) <= np.degrees(1.645 * session.std[rows][:, shown])
        for name, joints in (('all', np.ones_like(leg)), ('leg', leg)):
            result[f'{part} {name}'] = {
                'rms_deg': np.sqrt(np.mean(error[:, :, joints]**2, axis=(0, 2))).tolist(),
                'zero_velocity_rms_deg': np.sqrt(np.mean(still[:, :, joints]**2, axis=(0, 2))).tolist(),
                'coverage_90': inside[:, :, joints].mean(axis=(0, 2)).tolist()}
        result[f'{part} windows'] = int(rows.sum())
    return result


def _phase_errors(session, show, dark, method):
    """Phase against that of the same model with every sensor and no network, % of a cycle (RMS)."""
    predictor = load_predictor(show.model, method)
    reference = np.array([predictor.update(time, pose).phase for time, pose in zip(
        session.truth.times, session.truth.joints(predictor.joint_names).positions)])
    phase = np.array([message.phase for message in session.estimates])
    nearest = np.clip(np.searchsorted(session.truth.times, session.estimated_at - 1e-6), 0, len(reference) - 1)
    parts = {'before': (session.estimated_at > SETTLED_S) & (session.estimated_at < dark[0]),
             'during': (session.estimated_at >= dark[0]) & (session.estimated_at < dark[1])}
    return {part: float(phase_error_percent(phase[rows], reference[nearest][rows])) for part, rows in parts.items()}


def _print(result):
    print('\nRMS prediction error in degrees (zero velocity is shown the true pose, dark leg included)')
    print(f'{"":12}|{"before, all joints":^32}|{"leg dark, all joints":^32}|{"leg dark, that leg":^32}')
    print(f'{"horizon":12}|' + f'{"predictor":>11}{"zero vel.":>11}{"in 90 %":>10}|' * 3)
    for row, ahead in enumerate(result['horizons_s']):
        cells = [result[part] for part in ('before all', 'during all', 'during leg')]
        print(f'{1e3 * ahead:8.0f} ms |' + '|'.join(
            f'{cell["rms_deg"][row]:11.2f}{cell["zero_velocity_rms_deg"][row]:11.2f}'
            f'{100 * cell["coverage_90"][row]:8.0f} %' for cell in cells) + '|')
    phase, latency, messages = result['phase_error_percent'], result['latency_ms'], result['messages']
    print(f'\nPhase, against the same filter with every sensor: {phase["before"]:.2f} % of a cycle before, '
          f'{phase["during"]:.2f} % during the loss (RMS)')
    print(f'Latency, joint state stamped to trajectory received: p50 {latency["p50"]:.2f} ms, '
          f'p99 {latency["p99"]:.2f} ms')
    print(f'{messages["sent"]} joint states seen, {messages["answered"]} answered; {result["before windows"]} + '
          f'{result["during windows"]} predictions scored')


def _curves(session, dark):
    """Actual and predicted joints with the band, around the loss."""
    ahead = int(np.argmin(np.abs(session.horizons - DRAWN_S)))
    names = [name for name in ('lfemur.rx', 'rfemur.rx', 'ltibia.rx', 'rtibia.rx', 'lfoot.rx', 'lhumerus.rx')
             if name in session.names]
    columns = [session.names.index(name) for name in names]
    start, stop = dark[0] - 2, dark[1] + 2
    rows = (session.at + session.horizons[ahead] > start) & (session.at < stop)
    actual = (session.truth.times > start) & (session.truth.times < stop)
    label = f'predicted {1e3 * session.horizons[ahead]:.0f} ms before'
    return pictures.joint_curves(
        names, [pictures.Line('actual', session.truth.times[actual], session.truth.positions[actual][:, columns]),
                pictures.Line(label, session.at[rows] + session.horizons[ahead], session.mean[rows, ahead][:, columns],
                              session.std[rows, ahead][:, columns])],
        title='Predicted joints; the left leg is dark for a while', spans=[(*dark, 'left leg dark')])


def _course(session, dark):
    """Phase, style, status and behaviours over time."""
    figure, axes = plt.subplots(4, 1, figsize=(10, 8), sharex=True, constrained_layout=True)
    at = session.estimated_at
    axes[0].plot(at, [message.phase for message in session.estimates], '.', ms=1.5, color='#0072b2')
    axes[0].set_ylabel('phase (rad)')
    longest = max(len(message.style) for message in session.estimates)
    style = np.full((len(at), longest), np.nan)
    for row, message in enumerate(session.estimates):
        style[row, :len(message.style)] = message.style
    axes[1].plot(at, style, lw=1)
    axes[1].set_ylabel('style')
    names = sorted({name for message in session.estimates for name in message.behaviours})
    for name in names:
        axes[2].plot(at, [dict(zip(m.behaviours, m.behaviour_probabilities)).get(name, np.nan)
                          for m in session.estimates], lw=1, label=name)
    if names:
        axes[2].legend(fontsize=8, frameon=False, loc='center right')
    axes[2].set_ylabel('behaviour')
    axes[2].set_ylim(-0.05, 1.05)
    width = np.degrees(1.645 * session.std[:, -1]).mean(axis=1)
    axes[3].plot(session.at, width, lw=1, color='#009e73')
    axes[3].set_ylabel(f'90 % band at\n{1e3 * session.horizons[-1]:.0f} ms (deg)')
    axes[3].set_ylim(0, np.percentile(width[session.at > 0.5], 99.5) * 1.2)
    axes[3].set_xlabel('time (s)')
    for axis in axes:
        axis.axvspan(*dark, color='#cc79a7', alpha=0.15, lw=0)
        axis.spines[['top', 'right']].set_visible(False)
    figure.suptitle('Phase, style and how sure; shaded: the left leg is dark', x=0.01, ha='left')
    return figure


def _figures(session, show, dark):
    """Actual poses and those predicted at the farthest horizon, before and after the loss."""
    times = np.concatenate([dark[0] - np.array([1.4, 1.1, 0.8, 0.5]), dark[0] + np.array([0.8, 1.1, 1.4, 1.7]),
                            dark[1] + np.array([0.8, 1.1, 1.4])])
    predicted = Motion(session.names, session.mean[:, -1], session.at + session.horizons[-1])
    label = f'predicted {1e3 * session.horizons[-1]:.0f} ms before'
    return pictures.stick_pair(show.skeleton, [('actual', session.truth), (label, predicted)], times,
                               title=f'Poses; from {dark[0]:g} to {dark[1]:g} s the left leg is dark')
