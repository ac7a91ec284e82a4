"""Calibration boards: find a checkerboard or ChArUco board in pictures, and calibrate the camera from it."""
