"""Errors, colour, files and progress: what every other package may lean on."""
