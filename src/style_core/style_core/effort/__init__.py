"""Effort: motions that are freer, stronger or more sudden (Torresani, Hackney and Bregler 2006)."""
from style_core.effort.content import joint_scale
from style_core.effort.descriptors import EFFORTS
from style_core.effort.interpolation import ALPHA_RANGE, interpolate_motions
from style_core.effort.library import EffortLibrary, load, save, train_library
from style_core.effort.restyle import LiveRestyler, restyle
from style_core.effort.segmentation import Segmenter, segment
from style_core.effort.warping import warp

__all__ = ['ALPHA_RANGE', 'EFFORTS', 'EffortLibrary', 'LiveRestyler', 'Segmenter', 'interpolate_motions', 'joint_scale',
           'load', 'restyle', 'save', 'segment', 'train_library', 'warp']
