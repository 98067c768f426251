"""What a locomotion model holds, for ``motion-style info``."""
from style_core.locomotion.model import from_arrays

__all__ = ['describe']


def describe(header, arrays):
    """Sizes of the model and a row for each style."""
    model = from_arrays(header, arrays)
    return {
        'positions_per_cycle': model.n_positions,
        'largest_jump': int(model.jumps.shape[1]),
        'smoothing': model.smoothing,
        'coupling': model.coupling,
        'bound_nats': float(model.bounds[-1]),
        'recordings': len(model.recordings),
        'styles': [
            {
                'style': name,
                'weight': float(weight),
                'period_s': float(period),
                'recordings': ' '.join(r for r, row in zip(model.recordings, model.labels) if row.argmax() == c) or '-',
            }
            for c, (name, weight, period) in enumerate(zip(model.style_names, model.weights, model.periods_s))
        ],
    }
