"""What commands read from bags."""
