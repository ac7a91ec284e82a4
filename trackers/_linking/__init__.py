"""Detections linked over frames into tracklets, bodies and Tracks."""
