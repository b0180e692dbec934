"""Measured reflectance: tables, files, factors, and the models that edit them."""

from burnish.materials.measured.editing import edited_table, measured_material
from burnish.materials.measured.merl import read_merl, write_merl
from burnish.materials.measured.samples import table_of_samples
from burnish.materials.measured.space import measured_space
from burnish.materials.measured.table import ReflectanceTable

__all__ = [
    "ReflectanceTable",
    "edited_table",
    "measured_material",
    "measured_space",
    "read_merl",
    "table_of_samples",
    "write_merl",
]
