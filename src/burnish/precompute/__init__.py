"""Estimators: a scene and a basis become transport, by symbolic path tracing."""
