"""Regions that change brightness, level or orientation."""
