"""What the programs of this project have in common."""
