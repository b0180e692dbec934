"""One reflectance model per file, and what several of them share."""
