"""The synthesizer node and its terminal slider."""
