"""Detection of candidate bodies in one frame, with sub-pixel centroids."""
