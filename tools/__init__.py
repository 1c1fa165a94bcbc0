"""Commands for those who work on the project: fuzzing, mutants, figures, recorded flights."""
