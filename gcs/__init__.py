"""The ground daemon."""
