"""Calibration boards: find a checkerboard or ChArUco board in images, and calibrate the camera from it."""
