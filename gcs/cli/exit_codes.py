"""With what the commands of `gcs` end; 0 is done."""

REFUSED, NOT_RIGHT, NO_GROUND = 1, 2, 3
