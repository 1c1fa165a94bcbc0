"""Many flights with faults, judged by what is true of the simulated drones, and never by what the product says."""
