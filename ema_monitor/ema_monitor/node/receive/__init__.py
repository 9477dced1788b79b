"""Reception of a monitor: admitted messages become windows, measurements and counts."""
