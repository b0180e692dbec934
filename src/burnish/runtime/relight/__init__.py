"""Pictures under changed lights and materials at once: the evaluation of `GatherData`."""
