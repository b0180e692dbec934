"""The version, where packages below `burnish` itself can read it."""

__version__ = "0.1.0"
