"""`gcs doctor`: everything that can be checked before a motor turns. Checks are pure; the survey around them is not."""
