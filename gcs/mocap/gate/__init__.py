"""The gate: which aligned poses are believed, body by body. What it rejects counts as not seen, and says why.

bounds    what each body can do, from its vehicle's profile        checks   names, limits and words; the README's table
path      whether a pose follows from those before it              judge    all checks of one frame, compiled
stamps    capture times against arrivals                           episodes what is told of rejections
"""
