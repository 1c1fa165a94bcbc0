"""The operator's page: a process of its own that reads the lab's bus and asks the ground by the operator's key.

View model and drawing are pure (`show`, `scene`, `drawing`); `shell` is the web server.
"""
