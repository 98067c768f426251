"""Styles found in unlabelled cyclic motion (Pan and Torresani 2009): docs/locomotion.md derives and explains it."""
from style_core.locomotion.choose import choose_styles
from style_core.locomotion.infer import aligned_cycles, analyze, fill
from style_core.locomotion.learn import learn
from style_core.locomotion.model import KIND, LocomotionModel, load, save
from style_core.locomotion.online import LocomotionPredictor, fill_causally
from style_core.locomotion.synthesis import Blend, parse_blend, prototypes, synthesize

__all__ = ['KIND', 'Blend', 'LocomotionModel', 'LocomotionPredictor', 'aligned_cycles', 'analyze', 'choose_styles',
           'fill', 'fill_causally', 'learn', 'load', 'parse_blend', 'prototypes', 'save', 'synthesize']
