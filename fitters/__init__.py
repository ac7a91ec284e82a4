"""The ODE engine and its models; import them through ``iris_sysid``."""

DISTRIBUTION = "iris-sysid"  # the registry tells this package from a foreign one by it
