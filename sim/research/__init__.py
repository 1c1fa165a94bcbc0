"""What one researcher uses: the paper's tables, searches for gains, a league of laws, what if; publications."""
