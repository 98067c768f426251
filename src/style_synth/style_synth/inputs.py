"""What the synthesizer hears, as arrays."""
import numpy as np

from style_core.synthesis.repertoire import Score

__all__ = ['score_of']


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
