"""Reflectance: models in sum-of-products form, layers of them, and the numbers of a state."""
