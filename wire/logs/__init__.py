"""MCAP logs, written and read."""

COLOURS = ("#2b3440", "#1f77d0", "#e8772e", "#2a9d6f", "#b5459b", "#8a6d1f", "#0f9fb4", "#7a56c8", "#c94f5d")
"""Of vehicles in every picture and viewer, leader first."""
ALARM = "#c2372e"
