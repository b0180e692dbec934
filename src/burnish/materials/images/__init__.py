"""Pictures over a surface in place of one value: their texels, and how they lie on it."""

from burnish.materials.images.image import ImageMap, Images, Place, Transform, transform_of
from burnish.materials.images.texels import Texels

__all__ = ["ImageMap", "Images", "Place", "Texels", "Transform", "transform_of"]
