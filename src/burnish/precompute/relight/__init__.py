"""Direct-to-indirect transfer (2010): gather samples, the light between them, and to a view."""
