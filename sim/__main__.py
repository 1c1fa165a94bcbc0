"""`gcs-sim`, and `python -m sim`: its command line is `sim.cli.app`."""

from sim.cli.app import main

if __name__ == "__main__":
    main()
