"""Images that trackers work on: cut, reduced, with or without colour."""
