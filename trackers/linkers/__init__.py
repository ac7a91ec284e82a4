"""Linkers: detections to tracks, one file each; see iris_sysid.link."""
