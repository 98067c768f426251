"""Hidden Markov models: the core that models of this package share."""
from style_core.hmm.gaussian import Moments, log_density, moments
from style_core.hmm.model import Hmm, Occupancy, check_hmm, em_step, filter_step, occupancy, viterbi

__all__ = ['Hmm', 'Moments', 'Occupancy', 'check_hmm', 'em_step', 'filter_step', 'log_density', 'moments',
           'occupancy', 'viterbi']
