"""Benchmarks of `make bench`: every figure a ratio, or beside its peer, within one run."""
