"""From what was asked to what is commanded: interpolation, replacement without a jump, limits."""
