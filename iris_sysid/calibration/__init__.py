"""Pixels to metres: scale, camera, lens distortion and the plane of motion, each with its uncertainty."""
