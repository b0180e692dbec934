"""Sessions: edits, undo, selection and frames; no sockets, no widgets."""

from burnish.session.session import ObjectInfo, Session

__all__ = ["ObjectInfo", "Session"]
