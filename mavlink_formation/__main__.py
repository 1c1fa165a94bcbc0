"""`python -P -m mavlink_formation MODULE ARGUMENTS`: a program of ours, beside packages of any name."""

from mavlink_formation.programs import module

if __name__ == "__main__":
    module()
