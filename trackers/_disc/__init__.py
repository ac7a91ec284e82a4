"""Disc model fitted to pixels: area coverage, shading, motion blur."""
