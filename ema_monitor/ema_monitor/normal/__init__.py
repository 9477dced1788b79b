"""What is normal for one unit, learned from its own tests, and what departs from it."""
