"""What a monitor receives: admitted messages become windows, measurements and counts."""
