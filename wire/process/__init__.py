"""Code that the programs of this project have in common."""
