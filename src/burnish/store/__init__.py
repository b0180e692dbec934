"""Bundles on disk: one Zarr v3 store with everything that editing needs."""

from burnish.store.bundle import Bundle, StoredView, open_bundle
from burnish.store.header import BundleHeader, ObjectHeader, ViewHeader
from burnish.store.writer import BundleWriter

__all__ = [
    "Bundle",
    "BundleHeader",
    "BundleWriter",
    "ObjectHeader",
    "StoredView",
    "ViewHeader",
    "open_bundle",
]
