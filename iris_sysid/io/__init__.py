"""Files on disk: CSV tables, JSON documents and their schemas, projects of Open Source Physics Tracker."""
