"""Motion of the camera: whether it moves, how in each frame, and the frames as a still camera would show them."""
