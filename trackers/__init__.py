"""Tracking algorithms, one a file; import them through ``iris_sysid.TRACKERS``."""

DISTRIBUTION = "iris-sysid"  # the registry tells this package from a foreign one by it
