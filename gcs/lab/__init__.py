"""A lab file, judged and drawn before anything is started."""
