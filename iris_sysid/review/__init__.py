"""Correct a track by hand in the browser: the session with its log, the page, and the local server."""
