"""`gcs watch`: the page's table in a terminal."""
