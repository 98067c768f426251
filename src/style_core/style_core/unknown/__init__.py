"""Motion that no model knows: short-range dynamics, and how far a model's forecasts are to be trusted beside them."""
from style_core.unknown.predictor import OpenPredictor
from style_core.unknown.short_range import ShortRange, learn_short_range, read_short_range

__all__ = ['OpenPredictor', 'ShortRange', 'learn_short_range', 'read_short_range']
