"""Frames with their exact times, from video containers, image sequences and tensors."""
