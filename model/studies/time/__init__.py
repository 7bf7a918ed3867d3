"""Time study: seconds of every part, and picture quality at equal time."""
