"""What a phase-style model holds."""
import numpy as np

from style_core.phase_style.model import restore_behaviours, restore_correction

__all__ = ['describe']


def describe(header, arrays):
    """Facts about every behaviour as plain values; angles in degrees."""
    rows, channels = [], []
    for one in restore_behaviours(header, arrays, 'this file'):
        energy = one.singular_values[1:] ** 2
        kept = energy[:one.style_dimension - 1].sum() / energy.sum() if energy.sum() > 0 else 1.0
        turn = 2 * np.pi if one.rhythmic else 1.0
        rows.append({
            'behaviour': one.name, 'kind': 'rhythmic' if one.rhythmic else 'discrete',
            'recordings': len(one.sequences), 'people': len(set(one.groups)), 'styles': one.style_dimension,
            'variation kept': f'{kept:.1%}', 'duration_s': float(turn / one.velocity[0]),
            'training residual_deg': float(np.degrees(np.sqrt(one.noise.mean()))),
            'methods': 'paper' if one.residual is None else 'full, paper'})
        channels.append({'behaviour': one.name, 'singular values': [float(v) for v in one.singular_values[:10]]})
    facts = {'behaviours': rows, 'spectrum': channels}
    correction = restore_correction(header, arrays, 'this file')
    if correction is not None:
        facts['histories'] = {
            'note': 'this file holds recorded motion of people: share it only where the recordings may be shared',
            'recordings': list(correction.histories.names), 'rate_hz': correction.histories.rate_hz,
            'duration_s': float(len(correction.histories.positions) / correction.histories.rate_hz),
            'mean weight while tracking': float(correction.weight[0].mean()),
            'mean weight while searching': float(correction.weight[1].mean())}
    return facts
