"""Style machines: stylistic hidden Markov models learned by entropy minimisation (Brand and Hertzmann 2000)."""
from style_core.style_machine.analysis import Analysis, analyze
from style_core.style_machine.choreography import (
    Primitive,
    bridge,
    graph_dot,
    primitives,
    random_walk,
    scale_dwell,
    sequence,
)
from style_core.style_machine.machine import KIND, StyleMachine, learn, load, save
from style_core.style_machine.streaming import Frame, StreamingSynthesizer
from style_core.style_machine.synthesis import synthesize, synthesize_visits, take
from style_core.style_machine.training import Settings

__all__ = ['KIND', 'Analysis', 'Frame', 'Primitive', 'Settings', 'StreamingSynthesizer', 'StyleMachine', 'analyze',
           'bridge', 'graph_dot', 'learn', 'load', 'primitives', 'random_walk', 'save', 'scale_dwell', 'sequence',
           'synthesize', 'synthesize_visits', 'take']
