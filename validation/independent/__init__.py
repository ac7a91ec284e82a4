"""A generator of test cases that shares no code with what it tests: SciPy integrates, OpenCV projects.

Nothing here imports ``fitters``, ``trackers`` or the renderer. A case is a table of times and observed values with the
truth beside it; the forms of its hidden effects are written from the physics, some of them deliberately not those of
the library, and their moments, frequencies and speed scales lie on no grid.
"""
