"""The background without its moving bodies, and its noise."""
