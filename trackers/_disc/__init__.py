"""Discs fitted to pixels: area coverage, shading, motion blur."""
