"""Honest baselines: simple on-line predictors that a better one has to beat, all behind `OnlinePredictor`."""

from style_core.baselines.known_phase import KnownPhase
from style_core.baselines.nearest import NearestHistories
from style_core.baselines.particles import ParticleFilter
from style_core.baselines.regression import LinearLeastSquares, RadialBasisNetwork
from style_core.baselines.still import ConstantVelocity, ZeroVelocity

__all__ = [
    'ZeroVelocity',
    'ConstantVelocity',
    'NearestHistories',
    'LinearLeastSquares',
    'RadialBasisNetwork',
    'ParticleFilter',
    'KnownPhase',
]
