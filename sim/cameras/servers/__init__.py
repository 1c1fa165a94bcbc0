"""Camera systems in a box: what the emulated cameras see, served in each vendor's own protocol."""
