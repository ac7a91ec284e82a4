"""Candidate bodies of one frame, with their sub-pixel centroids."""
