"""Bytes as middleware and servo buses deliver them."""
