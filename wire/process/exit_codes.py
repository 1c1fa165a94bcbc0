"""With what the commands of `gcs` end; 0 is done."""

REJECTED, NOT_RIGHT, NO_GROUND, NOT_LANDED = 1, 2, 3, 4
