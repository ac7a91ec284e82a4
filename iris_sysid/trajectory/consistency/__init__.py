"""Common sense before statistics: whether clock, scale and phenomenon can be right, from what the path itself shows."""
