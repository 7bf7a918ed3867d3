"""Open benchmark: pictures of a pinned list of views, scored against a dataset's truth."""
