"""Background without moving bodies, and its noise, from sampled frames."""
