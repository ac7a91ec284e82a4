"""Detectors: frames to detections, one file each; see iris_sysid.detect."""
