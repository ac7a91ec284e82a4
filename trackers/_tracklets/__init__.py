"""Detections linked from frame to frame into tracklets: what every other way of linking begins with."""
