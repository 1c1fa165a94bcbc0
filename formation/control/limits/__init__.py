"""What no demand may lead to, whatever the law asks: too fast, too near to another, out of the fence."""
