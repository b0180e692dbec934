"""burnish: edit materials in the finished scene, with every bounce of light answering."""

from burnish.core.version import __version__

__all__ = ["__version__"]
