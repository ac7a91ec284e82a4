"""Detections joined over frames into tracks."""
