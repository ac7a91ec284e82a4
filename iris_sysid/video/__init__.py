"""Frames with their exact times, from video containers and image sequences."""
