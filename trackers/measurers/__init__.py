"""Measurers: tracks to sub-pixel positions, one file each; see iris_sysid.measure."""
