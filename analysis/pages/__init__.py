"""Parts of pages about flights: events folded, what was flown with, two flights compared."""
