"""Who acts, when, on every fault; the phases; what forbids arming."""
