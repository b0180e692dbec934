"""Painted materials: strokes as values, the maps that they make, what varies from row to row."""
