"""The version of the distribution: what all three packages may import without importing anything else."""

__version__ = "0.2.0"
