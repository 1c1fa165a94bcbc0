"""The autopilots an agent can be, each as a model built on its table."""
