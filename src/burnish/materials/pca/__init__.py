"""Models that are edited through principal components (Nguyen et al. 2010)."""
