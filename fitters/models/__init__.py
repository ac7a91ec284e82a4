"""Governing equations, one a file."""
